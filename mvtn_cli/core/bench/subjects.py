"""What is looked at, from where, and in which light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.datasets.builtin.shapes import build as build_shape
from mvtn_cli.core.preprocess import Settings
from mvtn_cli.core.preprocess.making import build as build_stored
from mvtn_cli.core.render import MATERIALS, Look
from mvtn_cli.core.shapes import Shape
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.views import Cameras

BUILTIN = ("airplane", "chair", "teapot", "bookshelf", "car", "sofa", "table", "mug")  # no spheres: their outlines rest
DISTANCE = 2.2
GOLDEN_DEG = 137.508
POINT_RADII = (0.006, 0.015, 0.03)  # half a pixel at 224, and more than one and two
# As rows name it, and what it changes in the look.
DRAWN: dict[str, dict[str, Any]] = {
    "smooth": {"shading": "smooth"},
    "flat": {"shading": "flat"},
    **{f"points {radius:g}": {"kind": "points", "point_radius": radius} for radius in POINT_RADII},
}
SETTINGS = Settings(max_vertices=20_000, num_points=2048, seed=0)


@dataclass(frozen=True)
class Subject:
    """One mesh to measure with.

    Attributes:
        name: Short, unique within a benchmark.
        source: File or generator that it comes from.
        shape: Preprocessed as for training.
        number: Decides the light: even ones have a headlight and are white, odd ones a fixed light and a colour.
    """

    name: str
    source: str
    shape: StoredShape
    number: int

    @property
    def faces(self) -> int:
        """How many faces are drawn."""
        return len(self.shape.faces)


def builtin_subjects(count: int) -> list[Subject]:
    """The first `count` of eight meshes of `builtin:shapes`."""
    made = {name: build_shape(name, 0) for name in BUILTIN[:count]}
    return [Subject(name, shape.source, stored(shape), n) for n, (name, shape) in enumerate(made.items())]


def icosphere() -> Subject:
    """20,480 faces: for the cost alone, a sphere's gradient says nothing."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=5)
    vertices, faces = np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int32)
    shape = Shape(vertices=vertices, faces=faces, name="icosphere", source="subdivided icosahedron")
    return Subject("icosphere", shape.source, stored(shape), 1)


def stored(shape: Shape) -> StoredShape:
    """Preprocess one shape in memory, as `mvtn preprocess` would."""
    return build_stored(shape, SETTINGS, "0" * 16)[0]


def golden_spiral(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions spread evenly over the sphere.

    Returns:
        Azimuth in [-180, 180) and elevation, (count,) float64 degrees, from the top down.
    """
    k = np.arange(count) + 0.5
    return (k * GOLDEN_DEG) % 360 - 180, np.degrees(np.arcsin(1 - 2 * k / count))


def cameras_at(azimuth_deg: np.ndarray, elevation_deg: np.ndarray, batch: int = 1) -> Cameras:
    """Cameras (batch, M) that keep float64 angles: float32 ones would blur differences over small steps."""
    azimuth, elevation = (
        torch.from_numpy(np.ascontiguousarray(angles, np.float64)).expand(batch, -1).contiguous()
        for angles in (azimuth_deg, elevation_deg)
    )
    return Cameras(azimuth, elevation, torch.full_like(azimuth, DISTANCE))


def spiral_cameras(count: int, batch: int = 1) -> Cameras:
    """Cameras on a golden spiral around each of `batch` shapes."""
    return cameras_at(*golden_spiral(count), batch)


def look_at(subjects: Sequence[Subject], plan: Plan, **changes: Any) -> Look:
    """The look of these subjects: headlight and white for even ones, a drawn light and colour for odd ones.

    In one call all have a headlight or none has: for a mixed batch every subject gets its drawn light.

    Args:
        subjects: One or more.
        plan: For image size, material and seed.
        changes: Other fields; faces, one sample a pixel, smooth shading, a black background where nothing is said.
    """
    headlight = all(subject.number % 2 == 0 for subject in subjects)
    drawn = [light_and_color(subject.number, plan.seed) for subject in subjects]
    pairs = zip(subjects, drawn, strict=True)
    colors = [np.ones(3) if subject.number % 2 == 0 else color for subject, (_, color) in pairs]
    material = zip(("ambient", "diffuse", "specular", "shininess", "falloff"), MATERIALS[plan.look], strict=True)
    return Look(
        **{"image_size": plan.image_size, "kind": "mesh", "supersample": 1, **dict(material), **changes},
        colors=np.stack(colors).astype(np.float32),
        light_direction=None if headlight else np.stack([light for light, _ in drawn]).astype(np.float32),
    )


def light_and_color(number: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A unit vector towards the light and a colour whose largest channel is 1."""
    random = np.random.default_rng((seed, number))
    light, color = random.normal(size=3), random.uniform(0.3, 1.0, 3)
    return light / math.sqrt(light @ light), color / color.max()


def light_words(subject: Subject) -> str:
    """How this subject is lit, for the rows."""
    return "headlight" if subject.number % 2 == 0 else "fixed"
