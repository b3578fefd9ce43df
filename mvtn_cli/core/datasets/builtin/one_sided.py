"""`builtin:one-sided`: a task whose best view is known.

Every shape is a barrel that leans back and whose top is cut on a slant, so that the body says where its front
is. One of six smooth reliefs lies on the front and on nothing else: from behind, all classes look alike. The
front's azimuth is uniform, so no fixed camera serves, and a network that sees the points can find it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from mvtn_cli.core.datasets.builtin.mesh import Mesh
from mvtn_cli.core.datasets.builtin.shapes import shape_rng
from mvtn_cli.core.shapes import Shape

VERSION = 2
"""Goes up with each change that moves a vertex; stored shapes of another version are made again."""

CLASSES = ("cross", "dots", "horizontal-ridges", "ring", "vertical-ridges", "wedge")

FRONT_HALF_DEG = 55.0
"""The relief lies within this angle of the front."""

# Columns over the front and over the rest; rows from the foot (-1) to the rim (+1).
_FRONT, _REST, _ROWS = 22, 14, 17
_COLUMNS = _FRONT + _REST


@dataclass(frozen=True)
class Body:
    """All random draws of one shape except its class; lengths in units of about a barrel's height.

    Attributes:
        radius, half_height: Of the barrel.
        taper, bulge: Relative change of the radius towards the rim, and at mid-height.
        slant: How far the rim drops at the front, in radii.
        lean: How far the rim moves back.
        amplitude: Height of the relief.
        stroke, size: Width of the relief's strokes and half extent of its pattern, in patch units.
        shift: (x, y) of the pattern's centre, in patch units.
        azimuth_deg: Where the front looks after the turn: (sin a, 0, cos a).
    """

    radius: float
    half_height: float
    taper: float
    bulge: float
    slant: float
    lean: float
    amplitude: float
    stroke: float
    size: float
    shift: tuple[float, float]
    azimuth_deg: float


def build(index: int, seed: int = 0, split: str = "train") -> tuple[Shape, int]:
    """Make one shape, decided by the three arguments. Classes take turns: the label is index mod 6.

    Returns:
        The mesh (y up, own units, not normalised; `known_azimuth_deg` in [-180, 180) is where its front
        looks), and the label.
    """
    label = index % len(CLASSES)
    body = draw_body(shape_rng(seed, split, "one-sided", index))
    mesh = barrel(body, label).turned("y", body.azimuth_deg)
    name = f"{CLASSES[label]}/{split}_{index:05d}"
    source = f"builtin:one-sided {name}, seed {seed}"
    shape = Shape(
        vertices=mesh.vertices, faces=mesh.faces, name=name, source=source, known_azimuth_deg=body.azimuth_deg
    )
    return shape, label


def draw_body(rng: Generator) -> Body:
    """Draw everything but the class."""
    u = rng.uniform
    return Body(
        radius=u(0.42, 0.52),
        half_height=u(0.45, 0.60),
        taper=u(-0.15, 0.15),
        bulge=u(-0.05, 0.10),
        slant=u(0.2, 0.5),
        lean=u(0.1, 0.3),
        amplitude=u(0.06, 0.10),
        stroke=u(0.14, 0.26),
        size=u(0.50, 0.64),
        shift=(u(-0.08, 0.08), u(-0.08, 0.08)),
        azimuth_deg=u(-180.0, 180.0),
    )


def barrel(body: Body, label: int) -> Mesh:
    """Build the closed mesh, front towards +z: a mantle (36 columns of 17 rows) and two flat fans of caps."""
    angle, rise = _ANGLE[:, None], _RISE[None, :]
    profile = body.radius * (1 + body.taper * rise + body.bulge * (1 - rise**2))
    radius = profile + body.amplitude * relief(body, label)
    up = (rise + 1) / 2
    x = radius * np.sin(angle)
    y = body.half_height * rise - up * body.slant * body.radius * np.cos(angle)
    z = radius * np.cos(angle) - up * body.lean
    mantle = np.stack([x, y, z], axis=-1)
    # The rim's middle lies in its slanted plane.
    middles = np.array([[0, -body.half_height, 0], [0, body.half_height, -body.lean]])
    return Mesh(np.concatenate([mantle.reshape(-1, 3), middles]), _FACES)


def relief(body: Body, label: int) -> np.ndarray:
    """Height of a class's relief on the grid (columns, rows), 0 to about 1; exactly 0 off the front patch."""
    u, v = _PATCH_U, _RISE[None, :]
    x, y = u - body.shift[0], v - body.shift[1]
    stroke, size = body.stroke, body.size
    # Each pattern ends softly at a square a little larger than itself, and fades out before the patch does.
    square = 1 / (1 + np.exp((np.maximum(np.abs(x), np.abs(y)) - size - 0.1) / 0.04))
    fade = np.clip((1 - np.abs(u)) * 6, 0, 1) * np.clip((1 - np.abs(v)) * 6, 0, 1)
    thirds = (-0.8 * size, 0.0, 0.8 * size)
    match CLASSES[label]:
        case "cross":
            height = np.maximum(_stroke(x, stroke), _stroke(y, stroke)) * square
        case "dots":
            far = 0.75 * size
            centres = [np.hypot(x - i * far, y - j * far) for i in (-1, 1) for j in (-1, 1)]
            height = sum(_stroke(distance, stroke * 1.3) for distance in centres)
        case "horizontal-ridges":
            height = sum(_stroke(y - k, stroke * 0.8) for k in thirds) * square
        case "ring":
            height = _stroke(np.hypot(x, y) - size, stroke * 0.9)
        case "vertical-ridges":
            height = sum(_stroke(x - k, stroke * 0.8) for k in thirds) * square
        case _:  # wedge
            height = np.clip((y + size) / (2 * size), 0, 1) * square
    return height * fade


def _stroke(distance: np.ndarray, width: float) -> np.ndarray:
    return np.exp(-((distance / width) ** 2))


def _column_angles() -> np.ndarray:
    half = np.radians(FRONT_HALF_DEG)
    rest = np.linspace(half, 2 * np.pi - half, _REST + 1)[1:-1]
    return np.concatenate([np.linspace(-half, half, _FRONT + 1), rest])


def _topology() -> np.ndarray:
    """Faces (F, 3) of mantle and caps; diagonals alternate, so that no direction is preferred."""
    i, j = np.meshgrid(np.arange(_COLUMNS), np.arange(_ROWS - 1), indexing="ij")
    a, c = i * _ROWS + j, (i + 1) % _COLUMNS * _ROWS + j
    b, d = a + 1, c + 1
    even = np.stack([a, c, b, b, c, d], axis=-1)
    odd = np.stack([a, c, d, a, d, b], axis=-1)
    mantle = np.where(((i + j) % 2 == 0)[..., None], even, odd).reshape(-1, 3)
    foot = np.arange(_COLUMNS) * _ROWS
    rim = foot + _ROWS - 1
    middle = np.full(_COLUMNS, _COLUMNS * _ROWS)
    low = np.stack([np.roll(foot, -1), foot, middle], axis=-1)
    high = np.stack([rim, np.roll(rim, -1), middle + 1], axis=-1)
    return np.concatenate([mantle, low, high]).astype(np.int32)


_ANGLE = _column_angles()
_RISE = np.linspace(-1, 1, _ROWS)
_PATCH_U = np.where(np.arange(_COLUMNS) <= _FRONT, _ANGLE / np.radians(FRONT_HALF_DEG), 5.0)[:, None]
_FACES = _topology()
