"""Things that hold things: bookshelf (open) and wardrobe (closed). Both draw their outer sizes alike."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from mvtn_cli.core.datasets.builtin.chance import chance
from mvtn_cli.core.datasets.builtin.mesh import Mesh, ball, board, box, disc, join, mirrored_pair, rod


def _outer_size(rng: Generator) -> tuple[float, float, float]:
    """Width, height and depth of a cupboard: from a low sideboard to a narrow tower."""
    height = rng.uniform(0.6, 2.0)
    return float(np.clip(height * rng.uniform(0.4, 2.2), 0.5, 1.8)), height, rng.uniform(0.28, 0.75)


def _support(rng: Generator, width: float, depth: float) -> tuple[float, list[Mesh]]:
    """Feet or a plinth under a cupboard, and their height."""
    rise = rng.uniform(0.04, 0.2)
    if chance(rng, 0.4):
        return rise * 0.6, [board(width * 0.94, rise * 0.6, depth * 0.9)]
    size = rng.uniform(0.035, 0.07)
    x, z = width / 2 - size, depth / 2 - size
    round_feet = chance(rng, 0.5)
    foot = disc(size / 2, rise, 10) if round_feet else board(size, rise, size)
    return rise, [foot.at(i * x, 0, j * z) for i in (-1, 1) for j in (-1, 1)]


# ---------------------------------------------------------------- bookshelf


def bookshelf(rng: Generator) -> Mesh:
    """Open case with shelves, perhaps divided, perhaps without a back, with books on some shelves."""
    u = rng.uniform
    width, height, depth = _outer_size(rng)
    plate = u(0.025, 0.055)
    low, parts = _support(rng, width, depth)
    high = height - low
    shelves = max(3, round(high / u(0.26, 0.42)) + 1)
    levels = np.linspace(plate / 2, high - plate / 2, shelves)
    case = mirrored_pair(board(plate, high, depth).at((width - plate) / 2))
    case += [box(width - 2 * plate, plate, depth * 0.98).at(y=level) for level in levels]
    if chance(rng, 0.5):
        case.append(board(width - plate, high, 0.012).at(z=-depth / 2 + 0.006))
    columns = 2 if width > 0.9 and chance(rng, 0.6) else 1
    if columns == 2:
        case.append(board(plate, high, depth * 0.97).at(width * u(-0.15, 0.15)))
    room = (high - plate) / (shelves - 1) - plate
    filled = rng.random(shelves - 1) < 0.7
    filled[0] |= not filled.any()
    for level in levels[:-1][filled]:
        case += [book.at(y=level + plate / 2) for book in _books(rng, width - 2 * plate, room, depth)]
    return join([*parts, *(part.at(y=low) for part in case)])


def _books(rng: Generator, width: float, room: float, depth: float) -> list[Mesh]:
    """Row of upright books on y = 0 that begins at the left or right end and fills part of the width."""
    u = rng.uniform
    thick = u(0.02, 0.06, size=int(rng.integers(3, 9)))
    left = np.cumsum(thick) - thick - width / 2
    side = 1 if chance(rng, 0.5) else -1
    books = zip(left, thick, strict=True)
    return [
        board(t * 0.92, room * u(0.6, 0.93), depth * 0.7).at(side * (x + t / 2), 0, -depth * 0.1)
        for x, t in books
        if x + t < width / 2
    ]


# ---------------------------------------------------------------- wardrobe


def wardrobe(rng: Generator) -> Mesh:
    """Closed case with doors, perhaps drawers below, handles or knobs, perhaps a cornice."""
    u = rng.uniform
    width, height, depth = _outer_size(rng)
    low, parts = _support(rng, width, depth)
    high = height - low
    case = [board(width, high, depth)]
    if chance(rng, 0.5):  # what nobody sees from outside; drawn meshes often have it too
        case += [box(width - 0.04, 0.025, depth - 0.04).at(y=y) for y in np.arange(u(0.2, 0.5), high, u(0.3, 0.5))]
    drawers = int(rng.integers(1, 4)) if chance(rng, 0.5) else 0
    rows = drawers * high * u(0.14, 0.2)
    case += _drawers(rng, width, rows, drawers, depth / 2)
    doors = max(1, round(width / u(0.4, 0.65)))
    wide, tall = width / doors, high - rows
    handle = _handle(rng, tall)
    panel = chance(rng, 0.5)
    for k in range(doors):
        x, y = (k - (doors - 1) / 2) * wide, rows + tall / 2
        case.append(box(wide - 0.025, tall - 0.025, 0.03).at(x, y, depth / 2 + 0.015))
        if panel:
            case.append(box(wide * 0.66, tall * 0.8, 0.025).at(x, y, depth / 2 + 0.04))
        side = 1 if k % 2 == 0 else -1
        case.append(handle.at(x + side * (wide / 2 - 0.06), y, depth / 2 + 0.03))
    if chance(rng, 0.45):
        case.append(board(width + 0.08, 0.06, depth + 0.08).at(y=high))
    return join([*parts, *(part.at(y=low) for part in case)])


def _drawers(rng: Generator, width: float, height: float, count: int, front: float) -> list[Mesh]:
    knob = ball(0.05, 0.05, 0.05, 10)
    parts = []
    for k in range(count):
        y = (k + 0.5) * height / count
        parts.append(box(width - 0.025, height / count - 0.025, 0.03).at(0, y, front + 0.015))
        parts += mirrored_pair(knob.at(width * 0.25, y, front + 0.05))
    return parts


def _handle(rng: Generator, door: float) -> Mesh:
    """Knob or upright bar that sticks out of the plane z = 0."""
    if chance(rng, 0.5):
        return ball(0.06, 0.06, 0.06, 10).at(z=0.03)
    half = door * rng.uniform(0.08, 0.2)
    bar = rod((0, -half, 0.05), (0, half, 0.05), 0.013)
    return join([bar, *(rod((0, y, 0), (0, y, 0.05), 0.01, segments=8) for y in (-half * 0.8, half * 0.8))])
