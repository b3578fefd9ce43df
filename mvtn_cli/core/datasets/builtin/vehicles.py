"""Things that drive and fly: car and airplane. The front looks along +z."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from mvtn_cli.core.datasets.builtin.chance import chance
from mvtn_cli.core.datasets.builtin.mesh import (
    Mesh,
    ball,
    board,
    box,
    disc,
    join,
    loft,
    mirrored_pair,
    rod,
    rounded_box,
    slab,
    superellipse,
)

# ---------------------------------------------------------------- car

# Each kind's cabin: rear and front end of its foot and of its roof, in lengths from the tail; height.
_CABINS = {
    "saloon": ((0.16, 0.74), (0.30, 0.56), 0.44),
    "hatchback": ((0.02, 0.72), (0.10, 0.52), 0.50),
    "van": ((0.01, 0.90), (0.02, 0.76), 0.85),
    "pickup": ((0.42, 0.76), (0.46, 0.62), 0.52),
    "coupe": ((0.08, 0.66), (0.32, 0.50), 0.36),
    "bus": ((0.01, 0.99), (0.02, 0.95), 1.15),
}


def car(rng: Generator) -> Mesh:
    """Body with a cabin of one of six kinds on four wheels, perhaps with mirrors, a rack or a spoiler."""
    u = rng.uniform
    kind = str(rng.choice(list(_CABINS)))
    length, width = u(3.0, 5.0), u(1.5, 2.1)
    wheel, clear, body = u(0.28, 0.40), u(0.16, 0.30), u(0.45, 0.65)
    belt = clear + body
    parts = [_hull(width, length, clear, body, kind, u(0.75, 1.0))]
    roof = _CABINS[kind][2] * u(0.9, 1.2) + belt
    parts.append(_cabin(width, length, belt, roof, kind))
    if chance(rng, 0.5):
        parts += _inside(width, length, clear + 0.12, belt + 0.1)
    parts += _wheels(width, length, wheel, u(0.55, 0.64))
    lamp = ball(0.34, 0.2, 0.12, 10)
    parts += mirrored_pair(lamp.at(width * 0.36, clear + body * 0.6, length / 2 - 0.02))
    parts += [box(width * 0.9, 0.12, 0.16).at(0, clear + 0.1, k * length / 2) for k in (-1, 1)]
    if chance(rng, 0.6):
        parts += mirrored_pair(rounded_box(0.2, 0.13, 0.08, 0.03).at(width / 2 + 0.05, belt + 0.1, length * 0.17))
    if kind in ("van", "hatchback") and chance(rng, 0.4):
        parts += mirrored_pair(
            rod((width * 0.32, roof + 0.06, -length * 0.35), (width * 0.32, roof + 0.06, length * 0.02), 0.03)
        )
    if kind in ("coupe", "saloon") and chance(rng, 0.4):
        parts.append(box(width * 0.8, 0.05, 0.25).at(0, belt + 0.2, -length * 0.46))
        parts += mirrored_pair(box(0.05, 0.24, 0.12).at(width * 0.3, belt + 0.09, -length * 0.46))
    return join(parts)


def _hull(width: float, length: float, clear: float, body: float, kind: str, bonnet: float) -> Mesh:
    """Lower body as a loft along z of rounded rectangles; the bonnet may be lower than the belt line."""
    places = np.array([0.0, 0.03, 0.2, 0.5, 0.74, 0.97, 1.0])
    tops = np.array([0.85, 1.0, 1.0, 1.0, 1.0, bonnet, bonnet * 0.85])
    if kind == "pickup":
        tops[:3] *= 0.92
    wide = np.array([0.88, 0.96, 1.0, 1.0, 1.0, 0.93, 0.84]) * width
    ring = superellipse(1, 1, 6, 24)
    rings = [
        np.column_stack([w * ring[:, 0], clear + body * t * (ring[:, 1] + 0.5), np.full(len(ring), (p - 0.5) * length)])
        for p, t, w in zip(places, tops, wide, strict=True)
    ]
    return loft(np.array(rings), rings[0].mean(0), rings[-1].mean(0))


def _cabin(width: float, length: float, belt: float, roof: float, kind: str) -> Mesh:
    """Greenhouse: a loft upwards from the belt line to the roof, narrower above."""
    foot, top, _ = _CABINS[kind]
    middle = tuple(f + 0.82 * (t - f) for f, t in zip(foot, top, strict=True))
    levels = [(foot, belt - 0.05, 0.94), (middle, belt + 0.82 * (roof - belt), 0.80), (top, roof, 0.70)]
    rings = []
    for (rear, front), y, share in levels:
        outline = superellipse(width * share, (front - rear) * length, 9, 24)
        z = ((rear + front) / 2 - 0.5) * length - outline[:, 1]  # counter-clockwise seen from above
        rings.append(np.column_stack([outline[:, 0], np.full(24, y), z]))
    return loft(np.array(rings), rings[0].mean(0), rings[-1].mean(0))


def _inside(width: float, length: float, low: float, high: float) -> list[Mesh]:
    """Floor and two rows of seats."""
    seat = [board(width * 0.36, 0.2, 0.5).at(y=low), board(width * 0.36, high - low, 0.12).at(y=low, z=-0.25)]
    rows = [join(seat).at(width * 0.22, 0, z * length) for z in (-0.2, 0.03)]
    return [
        box(width * 0.85, 0.05, length * 0.9).at(y=low),
        *(part for row in rows for part in mirrored_pair(row)),
    ]


def _wheels(width: float, length: float, radius: float, base: float) -> list[Mesh]:
    tyre = disc(radius, 0.24, 18).turned("z", -90).at(width / 2 - 0.2, radius)
    hub = disc(radius * 0.55, 0.03, 12).turned("z", -90).at(width / 2 + 0.03, radius)
    one = join([tyre, hub])
    return [part for z in (-base, base) for part in mirrored_pair(one.at(z=z * length / 2))]


# ---------------------------------------------------------------- airplane


def airplane(rng: Generator) -> Mesh:
    """Fuselage with wings, tail and fin, and jets under the wing, at the tail or inside, or a propeller."""
    u = rng.uniform
    radius = u(0.10, 0.20)
    parts = [_fuselage(rng, radius)]
    kind = rng.choice(["airliner", "airliner", "rear jets", "propeller", "fighter"])
    root, span = u(0.35, 0.55), u(0.75, 1.15)
    sweep, taper = (u(0.0, 0.08), u(0.6, 1.0)) if kind == "propeller" else (u(0.2, 0.6), u(0.2, 0.45))
    if kind == "fighter":
        root, span, sweep, taper = u(0.7, 1.0), u(0.5, 0.75), u(0.5, 0.75), u(0.05, 0.25)
    high = kind == "propeller" and chance(rng, 0.6)
    y, lift = (radius * 0.8 if high else -radius * 0.5), u(0.0, 7.0)
    place = u(-0.05, 0.12)
    wing = _wing(root, span, sweep, taper, 0.045).turned("z", lift).at(0, y, place)
    parts += mirrored_pair(wing.at(x=0.01))
    tail_y = radius * 0.4
    fin = _wing(u(0.25, 0.36), u(0.28, 0.42), u(0.12, 0.25), u(0.4, 0.7), 0.03).turned("z", 90)
    parts.append(fin.at(0, tail_y * 0.5, -0.84))
    t_tail = kind == "rear jets" or chance(rng, 0.15)
    tail = _wing(u(0.18, 0.28), u(0.28, 0.42), u(0.05, 0.2), u(0.4, 0.8), 0.025)
    parts += mirrored_pair(tail.at(0.01, tail_y + (0.32 if t_tail else 0), -0.92 if t_tail else -0.86))
    parts += _engines(rng, str(kind), radius, y, place, sweep / span, np.tan(np.radians(lift)))
    if kind == "propeller" or chance(rng, 0.25):
        parts += _gear(radius)
    return join(parts)


def _fuselage(rng: Generator, radius: float) -> Mesh:
    """Tube along z from the tail at -1 to the nose at +1; the tail rises."""
    nose = rng.uniform(0.6, 0.85)
    z = np.array([-1.0, -0.8, -0.5, -0.2, 0.2, nose, 0.5 + nose / 2, 0.8 + nose * 0.17, 1.0])
    size = radius * np.array([0.18, 0.45, 0.85, 1.0, 1.0, 1.0, 0.82, 0.5, 0.1])
    rise = radius * np.array([0.6, 0.42, 0.12, 0.0, 0.0, 0.0, -0.05, -0.12, -0.2])
    t = np.arange(18) * 2 * np.pi / 18
    rings = [
        np.column_stack([s * np.cos(t), s * np.sin(t) + r, np.full(18, q)])
        for q, s, r in zip(z, size, rise, strict=True)
    ]
    return loft(np.array(rings), rings[0].mean(0), rings[-1].mean(0))


def _wing(root: float, span: float, sweep: float, taper: float, thick: float) -> Mesh:
    """Right half of a wing from x = 0 to x = span, chord along z; its tip lies `sweep` further back."""
    outline = np.array([(-0.5, 0.0), (-0.2, 0.4), (0.25, 0.5), (0.5, 0.0), (0.25, -0.4), (-0.2, -0.4)])
    sections = []
    for share in (0.0, 0.5, 1.0):
        chord = root * (1 + share * (taper - 1))
        z = chord * outline[:, 0] - sweep * share - (root - chord) * 0.25
        y = thick * outline[:, 1] * (1 + share * (taper - 1))
        sections.append(np.column_stack([np.full(len(z), share * span), y, z]))
    rings = np.array(sections)
    return loft(rings, rings[0].mean(0), rings[-1].mean(0))


def _engines(rng: Generator, kind: str, radius: float, y: float, place: float, slope: float, lift: float) -> list[Mesh]:
    u = rng.uniform
    if kind == "fighter":
        return [rod((0, 0, -0.9), (0, 0, -1.08), radius * 0.6, radius * 0.45, 14)]
    if kind == "propeller":
        return _propeller(rng, radius)
    size = u(0.055, 0.085)
    jet = rod((0, 0, 0.13), (0, 0, -0.13), size, size * 0.7, 14)
    if kind == "rear jets":
        return mirrored_pair(jet.at(radius * 0.75 + size, radius * 0.3, -0.55))
    pylons = []
    for x in (0.34, 0.62)[: int(rng.integers(1, 3))]:
        under = y + lift * x
        pylons.append(jet.at(x, under - size * 1.3, place - slope * x + 0.16))
        pylons.append(box(0.02, size * 1.2, 0.16).at(x, under - size * 0.6, place - slope * x + 0.08))
    return mirrored_pair(join(pylons))


def _propeller(rng: Generator, radius: float) -> list[Mesh]:
    """Spinner and blades on the nose, the blades at a random turn."""
    blade = slab(superellipse(0.06, 0.3, 3, 16), 0.015).at(y=0.17)
    count, turn = int(rng.integers(2, 5)), rng.uniform(0, 180)
    blades = [blade.turned("z", turn + 360 * k / count).at(0, -radius * 0.2, 1.01) for k in range(count)]
    return [*blades, rod((0, -radius * 0.2, 0.95), (0, -radius * 0.2, 1.07), 0.05, 0.02)]


def _gear(radius: float) -> list[Mesh]:
    """Nose wheel and two main wheels on struts."""
    wheel = disc(0.06, 0.035, 12).turned("z", 90).at(0.018)
    drop = -radius - 0.16
    nose = [rod((0, -radius * 0.7, 0.6), (0, drop, 0.6), 0.012, segments=8), wheel.at(0, drop, 0.6)]
    main = join(
        [
            rod((radius * 0.5, -radius * 0.6, -0.02), (0.2, drop, -0.02), 0.015, segments=8),
            wheel.at(0.2, drop, -0.02),
        ]
    )
    return [*nose, *mirrored_pair(main)]
