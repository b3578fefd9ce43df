"""Views in bands of rows: how many there are is nobody's business but the clock's."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import pytest
from reference import scenes
from reference.drawing import cameras

from mvtn_cli.core.render import gbuffer, mesh
from mvtn_cli.core.render.bands import FEWEST_ROWS, band_rows, bands_for
from mvtn_cli.core.render.gbuffer import GBuffers
from mvtn_cli.core.render.mesh import MeshScene, camera_matrices
from mvtn_cli.core.render.skips import DRAWN, EVERYTHING, HIDDEN, SEEN, without
from mvtn_cli.core.store import StoredShape

SIZE = 40
CLOSE, AFAR, POLE = (20.0, 30.0, 0.4), (-130.0, -40.0, 1.7), (75.0, 90.0, 2.2)


def quads(count: int) -> StoredShape:
    """More faces than tiles are made for, far ones last."""
    random = np.random.default_rng(0)
    middle = np.sort(random.uniform(-0.8, 0.8, count))[::-1]
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.5
    vertices = np.concatenate([corners * random.uniform(0.2, 1) + [0, 0, z] for z in middle])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(count)])
    return scenes.stored(vertices, faces)


SHAPES = {
    "ball": scenes.icosahedron(),
    "bumpy": scenes.bumpy(12),
    "chair": scenes.chair(),
    "soup": scenes.soup(25, 1, colored=True),
    "quads": quads(5000),
}


@dataclass(frozen=True)
class Drawn:
    """What must not depend on bands."""

    same: dict[str, np.ndarray]
    counts: np.ndarray


def draw(name: str, views, *, supersample: int = 1, skips: int = EVERYTHING, shading: str = "smooth") -> Drawn:
    placed = cameras(*views)
    rts = camera_matrices(placed.azimuth_deg, placed.elevation_deg, placed.distance).numpy()
    look = scenes.look(SIZE, supersample=supersample, shading=shading, specular=0.2)
    scene = MeshScene(scenes.batch_of(SHAPES[name]), look, scenes.FOV, skips)
    buffers = scene.see(rts)
    images, samples = scene.paint(buffers)
    weights = np.random.default_rng(1).standard_normal(images.shape)
    same = {"ids": buffers.ids, "boxes": buffers.boxes, "jumps": buffers.jumps, "images": images}
    same |= {name: array for n in range(len(rts[0])) for name, array in seen_in(buffers, n).items()}
    same["gradient"] = scene.gradient(buffers, samples, weights)
    return Drawn(same, buffers.counts)


def seen_in(buffers: GBuffers, n: int) -> dict[str, np.ndarray]:
    """Jumps, and what is defined of the images of a view."""
    top, bottom, left, right = buffers.boxes[n]
    box = (n, slice(top, bottom + 1), slice(left, right + 1))
    covered, jumps = buffers.depth[box] != 0, buffers.jumps[n]
    found = {"depth": buffers.depth[box], "records": buffers.records[n, :jumps], "where": buffers.where[n, :jumps]}
    found |= {"normals": buffers.normals[box][covered], "links": buffers.links[box][covered]}
    if buffers.tints.shape[1]:
        found["tints"] = buffers.tints[box][covered]
    return {f"{name} of view {n}": array for name, array in found.items()}


def in_bands(monkeypatch: pytest.MonkeyPatch, bands: int, *args, **kwargs) -> Drawn:
    monkeypatch.setattr(mesh, "bands_for", lambda views, side: bands)
    return draw(*args, **kwargs)


def assert_same(found: Drawn, expected: Drawn) -> None:
    assert found.same.keys() == expected.same.keys()
    for what, array in expected.same.items():
        assert found.same[what].tobytes() == array.tobytes(), what


@pytest.mark.parametrize("views", [(AFAR,), (AFAR, CLOSE, POLE)], ids=["one view", "three views"])
@pytest.mark.parametrize("name", SHAPES)
def test_bytes_are_the_same_in_any_number_of_bands(name, views, monkeypatch):
    for supersample, shading in ((1, "smooth"), (2, "flat")):
        whole = in_bands(monkeypatch, 1, name, views, supersample=supersample, shading=shading)
        assert whole.same["jumps"].sum() > 0 and np.abs(whole.same["gradient"]).max() > 0
        for bands in (2, 3, 7, SIZE, 3 * SIZE):  # of one row, and more than there are rows
            found = in_bands(monkeypatch, bands, name, views, supersample=supersample, shading=shading)
            assert_same(found, whole)


@pytest.mark.parametrize("skip", ["frustum", "no-sample", "backface", "background", "near-clip", "occluded"])
def test_bytes_are_the_same_in_bands_with_a_skip_off(skip, monkeypatch):
    for name in ("ball", "quads"):
        whole = in_bands(monkeypatch, 1, name, (AFAR, CLOSE), skips=without([skip]))
        assert_same(in_bands(monkeypatch, 3, name, (AFAR, CLOSE), skips=without([skip])), whole)


@pytest.mark.parametrize("name", SHAPES)
def test_each_face_is_counted_once_also_in_bands(name, monkeypatch):
    """Only whether it is hidden behind tiles may be found in one band and not in the whole view."""
    whole = in_bands(monkeypatch, 1, name, (AFAR, CLOSE, POLE)).counts
    for bands in (2, 3, SIZE):
        counts = in_bands(monkeypatch, bands, name, (AFAR, CLOSE, POLE)).counts
        np.testing.assert_array_equal(counts[:, SEEN], len(SHAPES[name].faces))
        rest = [column for column in range(counts.shape[1]) if column not in (DRAWN, HIDDEN)]
        np.testing.assert_array_equal(counts[:, rest], whole[:, rest])
        np.testing.assert_array_equal(counts[:, [DRAWN, HIDDEN]].sum(1), whole[:, [DRAWN, HIDDEN]].sum(1))


def test_a_band_with_more_jumps_than_its_room_is_seen_again(monkeypatch):
    expected = in_bands(monkeypatch, 1, "soup", (AFAR, POLE))
    monkeypatch.setattr(gbuffer, "ROOM", 1)
    assert expected.same["jumps"].min() > SIZE
    for bands in (1, 2, 5):
        assert_same(in_bands(monkeypatch, bands, "soup", (AFAR, POLE)), expected)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="numba has one thread")
@pytest.mark.parametrize("views", [(AFAR,), (AFAR, CLOSE, POLE)], ids=["one view", "three views"])
@pytest.mark.parametrize("name", SHAPES)
def test_bytes_are_the_same_with_one_thread_and_with_two(name, views):
    before, found = numba.get_num_threads(), []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            assert bands_for(len(views), SIZE) == (2 if threads > len(views) else 1)
            found.append(draw(name, views))
    finally:
        numba.set_num_threads(before)
    assert_same(found[1], found[0])


@pytest.mark.parametrize(("threads", "views", "side", "bands"), [
    (2, 1, 224, 2), (2, 2, 224, 1), (2, 12, 224, 1), (16, 12, 224, 2), (16, 1, 224, 14), (8, 1, 8, 1), (1, 0, 224, 1),
])  # fmt: skip
def test_there_are_bands_where_there_are_fewer_views_than_threads(threads, views, side, bands, monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: threads)
    assert bands_for(views, side) == bands
    assert bands == 1 or side // bands >= FEWEST_ROWS


@pytest.mark.parametrize(("height", "bands"), [(40, 3), (40, 7), (8, 24), (9, 2), (1, 1)])
def test_bands_hold_each_row_once(height, bands):
    rows = [band_rows(band, bands, height) for band in range(bands)]
    assert [row for first, last in rows for row in range(first, last + 1)] == list(range(height))
