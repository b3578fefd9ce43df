"""The stiff set, T1 to T16: what breaks renderers, and what has to come out instead."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mvtn_cli.core.bench import stiff_checks as check
from mvtn_cli.core.bench import stiff_shapes as made
from mvtn_cli.core.bench.stiff_checks import Check
from mvtn_cli.core.store import StoredShape

MILLION = 500  # steps of `bumpy`
SCALES = (1e-12, 1e-6, 1e6, 1e12)


@dataclass(frozen=True)
class Case:
    """One stiff scene.

    Attributes:
        code: Its number in the list of docs/bench.md.
        name: What is stiff about it.
        shape: Makes the shape when its turn comes.
        azimuth, elevation: Of the cameras, degrees.
        distance: Of the cameras, shape radii.
        check: Says what is wrong with what was seen, beyond numbers that are not finite; empty if nothing.
        kind: "mesh" or "points".
        size: Pixels along each side, where the case is about that.
        point_radius: World radius of points.
        poisoned: The first view gets a NaN in its incoming gradient; what comes of that view is not judged.
        refused: The renderer must not draw this but say so.
    """

    code: str
    name: str
    shape: Callable[[], StoredShape]
    azimuth: tuple[float, ...] = (25.0, 140.0)
    elevation: tuple[float, ...] = (20.0, -50.0)
    distance: tuple[float, ...] = (2.2, 2.2)
    check: Check = check.nothing_more
    kind: str = "mesh"
    size: int | None = None
    point_radius: float = 0.02
    poisoned: bool = False
    refused: bool = False


def stiff_cases() -> list[Case]:
    """All of them, in order."""
    return [*_cameras(), *_meshes(), *_sizes(), *_scales(), *_points()]


def _at(azimuth: tuple[float, ...], elevation: tuple[float, ...], distance: tuple[float, ...] = ()) -> dict:
    """Cameras of a case; a single angle serves all."""
    count = max(len(azimuth), len(elevation), len(distance))
    spread = [values * count if len(values) == 1 else values for values in (azimuth, elevation, distance or (2.2,))]
    return dict(zip(("azimuth", "elevation", "distance"), spread, strict=True))


def _cameras() -> Iterator[Case]:
    wrap = _at((0.0, 360.0, 359.999, -0.001), (20.0,))
    yield Case("T1", "azimuth across the wrap", made.chair, **wrap, check=check.all_views_alike)
    far_round = _at((25.0, 25.0 + 360e5), (20.0,))
    yield Case("T1", "azimuth a hundred thousand turns on", made.chair, **far_round, check=check.all_views_alike)
    for pole in (90.0, -90.0):
        near = _at((30.0,), (pole, pole - 0.001, pole + 0.001))
        yield Case("T2", f"elevation {pole:+g}", made.chair, **near, check=check.all_views_alike)
    beyond = _at((30.0,), (90.5, 135.0, 180.0, 270.0, -100.0))
    yield Case("T2", "elevation beyond the poles", made.chair, **beyond, check=check.orthonormal_axes)
    yield Case(
        "T3", "closed-form axes", made.chair, **_at((-77.0, 12.0, 155.0), (3.0, 80.0, -41.0)), check=check.look_at
    )
    inside = _at((0.0, 80.0, 200.0), (0.0, 30.0, -60.0), (0.05,))
    yield Case("T4", "camera inside a closed box", made.box, **inside, check=check.covered)
    yield Case("T4", "camera inside boxes that meet", made.chair, **_at((10.0,), (20.0,), (0.1, 0.3, 0.01)))
    on_vertex = _at((45.0,), (35.264389682754654,), (0.75**0.5,))
    yield Case("T4", "camera on a vertex", made.box, **on_vertex)
    yield Case("T4", "camera 1e4 radii away", made.chair, **_at((30.0,), (20.0,), (1e4, 1e8)))


def _meshes() -> Iterator[Case]:
    plain, chair = partial(made.soup, 12, 5), made.chair
    yield Case("T5", "faces across the near plane", lambda: _scaled(made.soup(12, 1), 6.0))
    behind = _at((0.0,), (0.0,))
    yield Case("T5", "behind the camera", lambda: _shifted(plain(), (0, 0, 5)), **behind, check=check.background)
    yield Case("T6", "slivers of aspect 1e6", partial(made.slivers, 30, 1e-6))
    yield Case("T6", "needles thinner than a pixel", partial(made.slivers, 30, 0.002))
    yield Case("T7", "faces without area", _without_area)
    yield Case("T7", "normals of length zero", lambda: replace(plain(), normals=np.zeros((36, 3), np.float32)))
    opposite = partial(made.raw, [*made.LEVEL, (0.2, -0.7, 0.8)], [[0, 1, 2], [1, 0, 3]])
    yield Case("T7", "one edge, two opposite faces", opposite)
    for words, reverse in (("every face twice", False), ("every face twice, reversed", True)):
        yield Case("T8", words, partial(_twice, reverse), check=check.same_picture_as(chair))
    yield Case("T8", "coplanar faces that overlap", _coplanar, check=check.same_for_any_threads)
    yield Case("T8", "sheets a millionth apart", lambda: made.joined(made.box(), made.box((1 + 1e-6,) * 3)))
    square = [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]
    shared = _at((0.0, 0.0, 30.0), (0.0, 10.0, 0.0))
    halves = partial(made.raw, square, [[0, 1, 2], [0, 2, 3]])
    yield Case("T9", "a shared edge through pixel centres", halves, **shared, check=check.each_sample_once)
    one = {**_at((25.0,), (20.0,)), "size": 224}
    yield Case("T10", "one million faces", partial(made.bumpy, MILLION), **one)
    through = partial(made.joined, made.box(), made.box((0.5, 1.4, 0.5)), made.box((1.3, 0.3, 0.2), (0.1, 0.1, 0.1)))
    yield Case("T14", "surfaces through each other", through, check=check.same_for_any_threads)
    yield Case("T15", "NaN in one view's incoming gradient", chair, poisoned=True)
    yield Case("T15", "NaN and infinite vertices", lambda: made.not_finite(made.soup(12, 6)))
    yield Case("T15", "a vertex at 1e9", partial(made.raw, [*made.TILTED, (1e9, 3e8, -2e9)], [[0, 1, 2], [0, 1, 3]]))


def _sizes() -> Iterator[Case]:
    for size in (1, 3, 7):
        yield Case("T11", f"an image of {size}x{size}", made.chair, size=size)
    beside = _at((0.0, 180.0), (0.0,))
    yield Case("T11", "an empty view", lambda: _shifted(made.chair(), (30, 0, 0)), **beside, check=check.background)
    yield Case("T11", "no faces", partial(made.raw, made.TILTED, np.zeros((0, 3))), refused=True)
    edge_on = partial(made.raw, [[0, 0.5, 0.3], [0, -0.7, 0.1], [0, 0.1, -0.6]], [[0, 1, 2]])
    yield Case("T11", "one face edge-on", edge_on, **_at((0.0, 0.001), (0.0, 10.0)))
    yield Case("T11", "all vertices alike", partial(made.raw, np.full((3, 3), 0.1), [[0, 1, 2]]))


def _scales() -> Iterator[Case]:
    """Through other units and back, as preprocessing does it."""
    same = check.same_picture_as(partial(_journey, 1.0))
    for scale in SCALES:
        yield Case("T12", f"coordinates times {scale:g}, normalised", partial(_journey, scale), check=same)
    yield Case("T12", "shifted by 1e6 radii, normalised", partial(_journey, 1.0, (1e6, -1e6, 1e6)), check=same)
    for scale in (1e-6, 1e6):
        moved = _at((25.0,), (20.0,), (2.2 * scale,))
        yield Case("T12", f"coordinates and distance times {scale:g}, raw", partial(_enlarged, scale), **moved)


def _points() -> Iterator[Case]:
    def points(name: str, shape: Callable[[], StoredShape], **more: object) -> Case:
        return Case("T16", name, shape, kind="points", **more)  # type: ignore[arg-type]

    def scattered(count: int) -> StoredShape:
        return made.cloud(np.random.default_rng(4).uniform(-0.6, 0.6, (count, 3)))

    seen = check.every_view_has_gradient
    yield points("points that coincide", lambda: made.cloud(np.full((50, 3), 0.2)), check=seen)
    on_camera = _at((0.0,), (0.0,), (1.0,))
    yield points("a point on the camera", lambda: made.cloud([[0, 0, 1.0], [0.1, 0.2, 0.3]]), **on_camera)
    yield points("radius of a hundredth of a pixel", partial(scattered, 500), point_radius=1e-4, check=seen)
    yield points("one point", lambda: made.cloud([[0.3, 0.2, 0.1]]), check=seen)
    yield points("100,000 points", partial(scattered, 100_000), check=seen)
    yield points(
        "NaN and infinite points", lambda: made.cloud([[np.nan, 0, 0], [0, np.inf, 0], [0.1, 0.2, 0.3]]), check=seen
    )


def _scaled(shape: StoredShape, factor: float) -> StoredShape:
    return replace(shape, vertices=shape.vertices * np.float32(factor))


def _enlarged(factor: float) -> StoredShape:
    return _scaled(made.chair(), factor)


def _shifted(shape: StoredShape, by: tuple[float, ...]) -> StoredShape:
    return replace(shape, vertices=shape.vertices + np.array(by, np.float32))


def _without_area() -> StoredShape:
    plain = made.soup(12, 5)
    flat = made.raw(plain.vertices, [[0, 0, 1], [3, 4, 4], [6, 6, 6]], plain.normals)
    return made.joined(plain, flat)


def _twice(reverse: bool) -> StoredShape:
    return made.every_face_twice(made.chair(), reverse=reverse)


def _coplanar() -> StoredShape:
    tilted = np.array(made.TILTED)
    beside = tilted + 0.3 * (tilted[1] - tilted[0])
    return made.raw([*tilted, *beside], [[0, 1, 2], [3, 4, 5]])


def _journey(scale: float, shift: tuple[float, ...] = (0, 0, 0)) -> StoredShape:
    return made.rescaled(made.chair(), scale, shift)
