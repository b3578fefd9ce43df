"""Round things on a table: mug, teapot, bottle, vase. All stand on y = 0 and overlap in their proportions."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from mvtn_cli.core.datasets.builtin.chance import chance
from mvtn_cli.core.datasets.builtin.mesh import Mesh, ball, curve, join, lathe, mirrored_pair, rod, tube


def _hollow(outside: np.ndarray, wall: float, floor: float) -> np.ndarray:
    """Close an outer profile (K, 2) from the foot up to the lip by its inner side down to `floor`."""
    inside = outside[outside[:, 1] > floor] - np.array([wall, 0.0])
    inside[:, 0] = np.maximum(inside[:, 0], wall * 0.5)
    bottom = [[0.0, floor]] if len(inside) == 0 else [[inside[0, 0], floor], [0.0, floor]]
    return np.concatenate([[[0.0, outside[0, 1]]], outside, inside[::-1], bottom])


# ---------------------------------------------------------------- mug


def mug(rng: Generator) -> Mesh:
    """Open cup with one handle: straight, conical, bellied or flared."""
    u = rng.uniform
    radius = 0.5
    height = 2 * radius * u(0.75, 2.3)
    foot, belly, lip = radius * u(0.5, 1.1), radius * u(0.9, 1.3), radius * u(0.8, 1.25)
    control = [(foot, 0), (0.5 * (foot + belly), height * 0.2), (belly, height * u(0.4, 0.6)), (lip, height)]
    if chance(rng, 0.45):  # straight walls
        control = [(foot, 0), (foot + (lip - foot) * 0.5, height * 0.5), (lip, height)]
    outside = curve(control, 10)
    cup = lathe(_hollow(outside, u(0.04, 0.08), height * 0.07))
    low, high = height * u(0.12, 0.3), height * u(0.7, 0.9)
    return join([cup, _handle(rng, outside, low, high, u(0.2, 0.6), u(0.05, 0.10))])


def _handle(rng: Generator, outside: np.ndarray, low: float, high: float, reach: float, thick: float) -> Mesh:
    """Bent tube at the side +x from height `high` to `low`: an ear, a C or a square one."""
    start, stop = (float(np.interp(y, outside[:, 1], outside[:, 0])) - thick * 0.4 for y in (high, low))
    far = max(start, stop) + reach
    style = rng.choice(["round", "ear", "square"])
    if style == "square":
        inner = [(far - 0.06, high, 0), (far, high - 0.06, 0), (far, low + 0.06, 0), (far - 0.06, low, 0)]
        return tube([(start, high, 0), *inner, (stop, low, 0)], thick)
    lift = 0.12 * (high - low) if style == "ear" else 0.0
    middle = (high + low) / 2 + lift
    bend = [(start, high, 0), ((start + 2 * far) / 3, high + lift, 0), (far, middle, 0)]
    back = [((stop + 2 * far) / 3, low + lift, 0), (stop, low, 0)]
    return tube(curve(bend + back, 15), thick)


# ---------------------------------------------------------------- teapot


def teapot(rng: Generator) -> Mesh:
    """Bellied pot with a lid and knob, a spout on one side and a handle on the other or above."""
    u = rng.uniform
    radius = 0.5
    height = 2 * radius * u(0.65, 2.0)
    foot, rim, place = radius * u(0.5, 0.9), radius * u(0.35, 0.7), u(0.3, 0.6)
    outside = curve([(foot, 0), (radius, height * place), (rim, height)], 12)
    dome = height + u(0.03, 0.22)
    lid = curve([(rim * 1.08, height), (rim * 0.75, height + 0.7 * (dome - height)), (0.06, dome)], 6)
    pot = lathe([(0, 0), *outside, (rim * 1.08, height - 0.02), *lid, (0, dome)])
    knob = ball(0.16, u(0.1, 0.2), 0.16, 10).at(y=dome + 0.05)
    parts = [pot, knob, _spout(rng, outside, height)]
    if chance(rng, 0.5):  # the inner wall
        parts.append(lathe([(0, 0.05), *(outside[1:-1] * (0.92, 1.0)), (0, outside[-2, 1])]))
    if chance(rng, 0.3):
        top = dome + u(0.25, 0.5)
        wide = float(np.interp(height * 0.85, outside[:, 1], outside[:, 0]))
        bail = [
            (-wide, height * 0.85, 0),
            (-wide * 0.9, top * 0.9, 0),
            (0, top, 0),
            (wide * 0.9, top * 0.9, 0),
        ]
        parts.append(tube(curve([*bail, (wide, height * 0.85, 0)], 17), 0.04))
    else:
        low, high = height * u(0.15, 0.3), height * u(0.75, 0.9)
        parts.append(_handle(rng, outside, low, high, u(0.2, 0.45), u(0.04, 0.07)))
    return join(parts)


def _spout(rng: Generator, outside: np.ndarray, height: float) -> Mesh:
    """Tapered bent pipe that leaves the pot at -x and ends level with the rim."""
    u = rng.uniform
    low = height * u(0.2, 0.45)
    start = float(np.interp(low, outside[:, 1], outside[:, 0])) * 0.85
    far, tip = start + u(0.25, 0.55), height * u(0.85, 1.1)
    path = [
        (-start, low, 0),
        (-(start + far * 1.2) / 2, (low + tip) / 2 - 0.08, 0),
        (-far, tip, 0),
        (-far - 0.08, tip + 0.03, 0),
    ]
    wide = u(0.11, 0.17)
    return tube(curve(path, 9), np.linspace(wide, wide * 0.4, 9), segments=12)


# ---------------------------------------------------------------- bottle


def bottle(rng: Generator) -> Mesh:
    """Body, shoulder and narrow neck with a cap, cork or lip; slim or squat, round or square."""
    u = rng.uniform
    radius = 0.5
    body, neck = 2 * radius * u(0.6, 1.7), radius * u(0.22, 0.5)
    shoulder, throat = radius * u(0.2, 1.1), radius * u(0.3, 1.2)
    waist = radius * (u(0.75, 0.95) if chance(rng, 0.25) else 1.0)
    t = np.linspace(0, 1, 7)
    fall = (1 + np.cos(np.pi * t)) / 2 if chance(rng, 0.5) else np.sqrt(1 - 0.999 * t**2)
    curved = np.stack([neck + (radius - neck) * fall, body + shoulder * t], axis=-1)
    top = body + shoulder + throat
    profile = [(0, 0), (radius * 0.92, 0), (radius, 0.06), (waist, body * 0.5), *curved, (neck, top)]
    parts = [lathe([*profile, *_closure(rng, neck, top)])]
    if chance(rng, 0.5):  # the inner side of the glass
        parts.append(lathe([(0, 0.08), (radius * 0.9, 0.1), *(curved * (0.9, 1.0)), (0, top)]))
    if waist == radius and chance(rng, 0.5):  # label
        low, high = body * 0.12, body * 0.42
        parts.append(lathe([(radius * 0.9, low), (radius * 1.03, low), (radius * 1.03, high), (radius * 0.9, high)]))
    flat = u(0.5, 0.8) if chance(rng, 0.25) else 1.0
    return join(parts).scaled(z=flat)


def _closure(rng: Generator, neck: float, top: float) -> list[tuple[float, float]]:
    """End of a bottle's profile: screw cap, cork, or a thick open lip."""
    style = rng.choice(["cap", "cork", "lip"])
    if style == "cap":
        wide, high = neck * rng.uniform(1.15, 1.35), rng.uniform(0.12, 0.28)
        return [(wide, top), (wide, top + high), (0, top + high)]
    if style == "cork":
        return [
            (neck * 1.15, top),
            (neck * 1.15, top + 0.06),
            (neck * 0.75, top + 0.06),
            (neck * 0.85, top + 0.22),
            (0, top + 0.22),
        ]
    return [
        (neck * 1.25, top),
        (neck * 1.25, top + 0.1),
        (neck * 0.75, top + 0.1),
        (neck * 0.75, top - 0.1),
        (0, top - 0.1),
    ]


# ---------------------------------------------------------------- vase


def vase(rng: Generator) -> Mesh:
    """Open vessel with a belly, a narrower neck, a lip and a small foot; perhaps two handles or flowers."""
    u = rng.uniform
    radius = 0.5
    height = 2 * radius * u(0.9, 2.6)
    foot, neck, lip = radius * u(0.45, 0.9), radius * u(0.3, 0.75), radius * u(0.65, 1.05)
    place, throat = u(0.25, 0.55), u(0.72, 0.88)
    control = [(foot, 0), (radius, height * place), (neck, height * throat), (lip, height)]
    outside = curve(control, 14)
    outside[:, 0] = np.maximum(outside[:, 0], 0.12)
    base = [(foot * 1.15, 0), (foot * 1.15, height * 0.04)]
    parts = [lathe(_hollow(np.concatenate([base, outside + np.array([0, height * 0.04])]), 0.05, height * 0.1))]
    if chance(rng, 0.35):
        low, high = height * (place + 0.08), height * (throat + 0.04)
        ear = [(np.interp(y, outside[:, 1], outside[:, 0]), y, 0) for y in (high, low)]
        far = radius * u(1.0, 1.35)
        path = [ear[0], (far * 0.9, high + 0.05, 0), (far, (high + low) / 2 + 0.1, 0), ear[1]]
        parts += mirrored_pair(tube(curve(path, 11), 0.045))
    elif chance(rng, 0.3):
        parts += _flowers(rng, neck * 0.5, height * 0.5, height * u(1.2, 1.5))
    return join(parts)


def _flowers(rng: Generator, spread: float, low: float, high: float) -> list[Mesh]:
    u = rng.uniform
    parts = []
    for turn in u(0, 360) + np.arange(int(rng.integers(3, 6))) * 77.0:
        lean, size = u(0.15, 0.5), u(0.16, 0.28)
        top = high * u(0.9, 1.1)
        stem = rod((0, low, 0), (spread + lean, top, 0), 0.018, segments=6)
        parts.append(join([stem, ball(size, size * 0.7, size, 10).at(spread + lean, top)]).turned("y", turn))
    return parts
