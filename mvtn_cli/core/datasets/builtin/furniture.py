"""Things to sit on, eat at and lie on: chair, table, sofa, bed. About metres; the front looks along +z."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.random import Generator

from mvtn_cli.core.datasets.builtin.chance import chance
from mvtn_cli.core.datasets.builtin.mesh import (
    Mesh,
    board,
    box,
    curve,
    disc,
    join,
    mirrored_pair,
    post,
    rod,
    rounded_box,
    slab,
    superellipse,
    top_plate,
    tube,
)

_CORNERS = [(-1, -1), (-1, 1), (1, -1), (1, 1)]


# ---------------------------------------------------------------- chair


def chair(rng: Generator) -> Mesh:
    """Seat on legs or a pedestal, with a back of one of four styles and perhaps armrests."""
    u = rng.uniform
    width = u(0.38, 0.68)
    depth = width * u(0.8, 1.15)
    height, thickness = u(0.34, 0.62), u(0.03, 0.10)
    round_seat = chance(rng, 0.25)
    seat = top_plate(width, depth, thickness, 2.2 if round_seat else u(5, 12)).at(y=height - thickness)
    parts = [seat, *_seat_base(rng, width, depth, height - thickness, 0.66 if round_seat else 0.92)]
    back = join(_chair_back(rng, width * (0.8 if round_seat else 1.0), u(0.24, 0.75)))
    parts.append(back.turned("x", -u(2, 16)).at(y=height - 0.01, z=-depth / 2 * 0.9))
    if not round_seat and chance(rng, 0.4):
        parts += mirrored_pair(join(_armrest(width / 2, depth, height, u(0.16, 0.26), u(0.025, 0.05))))
    return join(parts)


def _seat_base(rng: Generator, width: float, depth: float, height: float, spread: float) -> list[Mesh]:
    u = rng.uniform
    style = rng.choice(["legs", "legs", "legs", "pedestal", "sled", "boards"])
    if style == "pedestal":
        return _pedestal(rng, height, width * u(0.42, 0.55))
    size = u(0.025, 0.065)
    x, z = width / 2 * spread - size / 2, depth / 2 * spread - size / 2
    if style == "boards":
        return mirrored_pair(board(size * 0.7, height, 2 * z).at(x))
    if style == "sled":
        loop = [(x, height, -z), (x, size / 2, -z), (x, size / 2, z), (x, height, z)]
        return mirrored_pair(join(rod(a, b, size / 2) for a, b in pairwise(loop)))
    parts = four_legs(rng, x, z, height, size, splay=u(0, 0.18) if chance(rng, 0.5) else 0.0)
    if chance(rng, 0.4):
        rail = height * u(0.2, 0.5)
        parts += mirrored_pair(rod((x, rail, -z), (x, rail, z), size * 0.35))
        parts.append(rod((-x, rail, 0), (x, rail, 0), size * 0.35))
    return parts


def four_legs(rng: Generator, x: float, z: float, height: float, size: float, splay: float = 0.0) -> list[Mesh]:
    """Four legs from (±x, height, ±z) down to the floor, square or round, perhaps tapered and splayed."""
    sides = 10 if chance(rng, 0.45) else 4
    foot = size * rng.uniform(0.5, 1.0)
    return [
        post((i * (x + splay * height), 0, j * (z + splay * height)), (i * x, height, j * z), foot, size, sides)
        for i, j in _CORNERS
    ]


def _pedestal(rng: Generator, height: float, reach: float) -> list[Mesh]:
    u = rng.uniform
    column = u(0.03, 0.06)
    if chance(rng, 0.35):
        return [disc(reach * 0.9, 0.025), disc(column, height - 0.01).at(y=0.01)]
    arms, low = int(rng.integers(4, 6)), u(0.05, 0.09)
    ends = [(reach * np.sin(t), low * 0.6, reach * np.cos(t)) for t in np.arange(arms) * 2 * np.pi / arms]
    feet = [rod((0, low + 0.03, 0), end, 0.03, 0.018) for end in ends]
    return [
        disc(column, height - low).at(y=low),
        *feet,
        *(disc(0.025, low * 0.7, 10).at(e[0], 0, e[2]) for e in ends),
    ]


def _chair_back(rng: Generator, width: float, height: float) -> list[Mesh]:
    """Back that stands upright on y = 0 in the plane z = 0."""
    u = rng.uniform
    size = u(0.025, 0.05)
    x = width / 2 - size / 2
    style = rng.choice(["panel", "slats", "ladder", "hoop"])
    if style == "panel":
        gap = height * u(0, 0.35)
        panel = slab(superellipse(width, height - gap, u(3, 12)), size).at(y=gap + (height - gap) / 2)
        return [
            panel,
            *mirrored_pair(rod((x * 0.6, 0, -size / 4), (x * 0.6, gap + 0.05, -size / 4), size / 3)),
        ]
    if style == "hoop":
        path = curve([(-x, 0, 0), (-x, height * 0.6, 0), (0, height, 0), (x, height * 0.6, 0), (x, 0, 0)], 17)
        places = np.linspace(-0.7, 0.7, int(rng.integers(3, 7))) * x
        tops = np.interp(places, path[4:13, 0], path[4:13, 1])
        spindles = [rod((p, 0, 0), (p, top, 0), size / 4, segments=8) for p, top in zip(places, tops, strict=True)]
        return [tube(path, size / 2), *spindles]
    posts = mirrored_pair(post((x, 0, 0), (x, height, 0), size, size))
    rail = u(0.05, 0.10)
    top = box(width, rail, size * 0.8).at(y=height - rail / 2)
    if style == "slats":
        places = np.linspace(-1, 1, int(rng.integers(4, 8)))[1:-1] * x
        return [*posts, top, *(board(u(0.02, 0.035), height - rail, size / 2).at(p) for p in places)]
    rungs = np.linspace(0.1, 1, int(rng.integers(3, 6)))[:-1] * height
    return [*posts, top, *(box(width, rail * 0.7, size / 2).at(y=r + rail / 2) for r in rungs)]


def _armrest(x: float, depth: float, height: float, rise: float, size: float) -> list[Mesh]:
    top = height + rise
    return [
        post((x, height - 0.04, depth * 0.3), (x, top, depth * 0.32), size, size),
        box(size * 1.6, size * 0.8, depth * 0.85).at(x, top, -depth * 0.06),
    ]


# ---------------------------------------------------------------- table


def table(rng: Generator) -> Mesh:
    """Top on legs, a pedestal, end panels or trestles; from a low coffee table to a bar table."""
    u = rng.uniform
    length = u(0.5, 1.4)
    depth = length * u(0.5, 1.0)
    height, thickness = u(0.35, 0.95), u(0.02, 0.09)
    exponent = 2.0 if chance(rng, 0.35) else u(6, 20)
    top = top_plate(length, depth, thickness, exponent).at(y=height - thickness)
    return join([top, *_table_base(rng, length, depth, height - thickness, 0.68 if exponent == 2.0 else 0.94)])


def _table_base(rng: Generator, length: float, depth: float, height: float, spread: float) -> list[Mesh]:
    u = rng.uniform
    style = rng.choice(["legs", "legs", "legs", "pedestal", "panels", "trestles"])
    size = u(0.035, 0.09)
    x, z = length / 2 * spread - size / 2, depth / 2 * spread - size / 2
    if style == "pedestal":
        return [part.scaled(z=depth / length) for part in _pedestal(rng, height, length * u(0.32, 0.45))]
    if style == "panels":
        inset = u(0.6, 1.0)
        beam = box(2 * x * inset, u(0.06, 0.14), size * 0.6).at(y=height * u(0.3, 0.8))
        return [*mirrored_pair(board(size * 0.7, height, 2 * z * u(0.6, 1)).at(x * inset)), beam]
    if style == "trestles":
        side = [post((x * 0.85, 0, k * z), (x * 0.75, height, k * z * 0.15), size, size) for k in (-1, 1)]
        side.append(rod((x * 0.8, height * 0.4, -z * 0.6), (x * 0.8, height * 0.4, z * 0.6), size * 0.35))
        return [
            *mirrored_pair(join(side)),
            rod((-x * 0.8, height * 0.4, 0), (x * 0.8, height * 0.4, 0), size * 0.35),
        ]
    parts = four_legs(rng, x, z, height, size, splay=u(0, 0.1) if chance(rng, 0.3) else 0.0)
    apron = u(0.05, 0.13) * height
    if chance(rng, 0.6):
        parts += [box(2 * x, apron, 0.02).at(y=height - apron / 2, z=k * z) for k in (-1, 1)]
        parts += mirrored_pair(box(0.02, apron, 2 * z).at(x, height - apron / 2))
    if chance(rng, 0.3):
        parts.append(box(2 * x, 0.025, 2 * z).at(y=height * u(0.2, 0.4)))
    return parts


# ---------------------------------------------------------------- sofa


def sofa(rng: Generator) -> Mesh:
    """Upholstered seat for one to three, with a back, arms of any height, cushions, perhaps a chaise."""
    u = rng.uniform
    seats = int(rng.integers(1, 4))
    arm = u(0.07, 0.26) if seats == 1 or chance(rng, 0.75) else 0.0
    seat = u(0.50, 0.70)
    width, depth, back = seats * seat, u(0.6, 1.05), u(0.10, 0.28)
    foot, base, cushion = u(0.02, 0.14), u(0.16, 0.26), u(0.10, 0.20)
    rise = foot + base + cushion
    top = rise + u(0.22, 0.65)
    soft = u(0.02, 0.08)
    parts = [rounded_box(width, base, depth, 0.02).at(y=foot + base / 2)]
    for k in range(seats):
        x = (k - (seats - 1) / 2) * seat
        long = depth * u(1.5, 1.8) if seats > 1 and k == seats - 1 and chance(rng, 0.35) else depth
        parts.append(
            rounded_box(seat * 0.97, cushion, long - back, soft).at(x, rise - cushion / 2, (long - depth + back) / 2)
        )
        if long > depth:
            parts.append(rounded_box(seat, base, long - depth, 0.02).at(x, foot + base / 2, long / 2))
        pad = rounded_box(seat * 0.94, top - rise, 0.16, soft).turned("x", -u(6, 14))
        parts.append(pad.at(x, (top + rise) / 2, back - depth / 2 + 0.04))
    parts.append(
        rounded_box(width + 2 * arm, (top - foot) * 0.93, back, soft).at(
            y=(top * 0.93 + foot) / 2, z=(back - depth) / 2
        )
    )
    if arm:
        high = rise - foot + u(0.04, 0.24)
        parts += mirrored_pair(rounded_box(arm, high, depth, soft).at((width + arm) / 2, foot + high / 2))
    legs = four_legs(rng, width / 2 - 0.04, depth / 2 - 0.06, foot, 0.06)
    return join([*parts, *legs])


# ---------------------------------------------------------------- bed


def bed(rng: Generator) -> Mesh:
    """Mattress on a frame with a headboard and pillows; perhaps a footboard, a canopy, or a bunk above."""
    u = rng.uniform
    width, length = u(0.75, 1.9), u(1.7, 2.1)
    frame, mattress, low = u(0.10, 0.28), u(0.12, 0.30), u(0.04, 0.30)
    style = rng.choice(["plain", "plain", "plain", "four-poster", "bunk"])
    if style == "bunk":
        width, frame, mattress = u(0.75, 1.1), 0.12, 0.16
    top = low + frame + mattress
    parts = [_mattress(rng, width, length, frame, mattress).at(y=low)]
    head = top + (0.2 if style == "bunk" else u(0.2, 0.75))
    parts.append(_headboard(rng, width + 0.08, head).at(z=-length / 2 - 0.05))
    if chance(rng, 0.45):
        parts.append(_headboard(rng, width + 0.08, top + u(0.0, 0.25)).at(z=length / 2 + 0.05))
    tall = low + 0.01 if style == "plain" else top + u(0.75, 1.2)
    if style == "four-poster":
        parts += _canopy(width / 2, length / 2, tall)
    elif style == "bunk":
        parts.append(_mattress(rng, width, length, frame, mattress).at(y=tall - mattress - frame - 0.15))
        parts.append(join(_ladder(tall)).at(width * 0.2, 0, length / 2 + 0.06))
    size = u(0.05, 0.10)
    parts += [board(size, tall, size).at(i * width / 2, 0, j * length / 2) for i, j in _CORNERS]
    return join(parts)


def _mattress(rng: Generator, width: float, length: float, frame: float, thick: float) -> Mesh:
    """Frame on y = 0 with a mattress, pillows at -z and perhaps a blanket."""
    u = rng.uniform
    top = frame + thick
    parts = [
        board(width + 0.06, frame, length + 0.06),
        rounded_box(width, thick, length, 0.06).at(y=frame + thick / 2),
    ]
    if chance(rng, 0.6):
        cover = length * u(0.4, 0.68)
        blanket = rounded_box(width + 0.09, thick * 0.9, cover, 0.05)
        parts.append(blanket.at(y=top - thick * 0.42, z=(length - cover) / 2))
    return join([*parts, *_pillows(rng, width, top, length)])


def _canopy(x: float, z: float, height: float) -> list[Mesh]:
    sides = mirrored_pair(rod((x, height, -z), (x, height, z), 0.03))
    return [*sides, *(rod((-x, height, j * z), (x, height, j * z), 0.03) for j in (-1, 1))]


def _ladder(height: float) -> list[Mesh]:
    """Leans on nothing: two rails along y and rungs along x, in the plane z = 0."""
    rails = mirrored_pair(rod((0.2, 0, 0), (0.2, height, 0), 0.025))
    return [*rails, *(rod((-0.2, y, 0), (0.2, y, 0), 0.02) for y in np.arange(0.25, height, 0.28))]


def _pillows(rng: Generator, width: float, top: float, length: float) -> list[Mesh]:
    u = rng.uniform
    count = 1 if width < 1.15 else 2
    wide = width / count * u(0.7, 0.9)
    pillow = rounded_box(wide, u(0.10, 0.16), u(0.32, 0.48), 0.06, steps=3).turned("x", u(0, 14))
    places = (np.arange(count) - (count - 1) / 2) * width / count
    return [pillow.at(x, top + 0.05, -length / 2 + 0.30) for x in places]


def _headboard(rng: Generator, width: float, height: float) -> Mesh:
    """Board that stands on y = 0 in the plane z = 0: plain, arched on top, or bars in a frame."""
    style = rng.choice(["plain", "arched", "bars"])
    if style == "plain":
        return rounded_box(width, height, 0.07, 0.03).at(y=height / 2)
    if style == "arched":
        t = np.linspace(0, np.pi, 17)
        shoulder = height * rng.uniform(0.7, 0.9)
        arch = np.stack([width / 2 * np.cos(t), shoulder + (height - shoulder) * np.sin(t)], axis=-1)
        return slab(np.concatenate([[(-width / 2, 0), (width / 2, 0)], arch]), 0.06)
    places = np.linspace(-width / 2, width / 2, int(rng.integers(6, 12)))
    bars = [rod((x, 0, 0), (x, height, 0), 0.02, segments=8) for x in places]
    rails = [rod((-width / 2, y, 0), (width / 2, y, 0), 0.03) for y in (height, height * 0.45)]
    return join([*bars, *rails])
