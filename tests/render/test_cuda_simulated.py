"""The CUDA back end in numba's simulator, in a process of its own, against the CPU back end: tiny scenes, no GPU.

The simulator runs kernels as Python, a system thread for each of CUDA's: it shows what threads do to each other, and
not what the compiler makes of them (`test_cuda_compiled.py`).
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from reference import scenes
from reference.drawing import cameras

from mvtn_cli.core.render import pack, raster, render, scene
from mvtn_cli.core.render.view_keeper import ViewKeeper, kept_batch

SIDE_LIGHT = np.float32([[0.48, 0.6, 0.64]])
SMOOTH = {"supersample": 2}
FLAT = {
    "shading": "flat",
    "specular": 0.2,
    "falloff": 1.0,
    "light_direction": SIDE_LIGHT,
    "background": (1.0, 1.0, 1.0),
}
DOTS = {"kind": "points", "point_radius": 0.12, "depth_cue": 0.4}
NEAR_BY, BELOW, INSIDE = (33.0, 21.0, 1.6), (200.0, -75.0, 2.2), (80.0, 30.0, 0.3)
STIFF = scenes.stiff()


def dotted(count: int, *, colored: bool = False):
    """Return a cloud some of whose points coincide."""
    random = np.random.default_rng(count)
    points = random.uniform(-0.6, 0.6, (count, 3))
    points[: count // 4] = points[0]
    return scenes.cloud(points, random.uniform(0, 1, (count, 3)) if colored else None)


def layers(gaps: list[float]):
    """Return parallel triangles, each `gap` nearer to the camera (0, 0, 2.2) than the one before."""
    flat = np.array([[-0.8, -0.5, 0.0], [0.9, -0.4, 0.0], [0.1, 0.8, 0.0]])
    heights = np.cumsum(gaps)
    return scenes.stored(np.concatenate([flat + np.array([0, 0, z]) for z in heights]), np.arange(3 * len(gaps)))


# By name: shapes, views, look.
MESHES = {
    "chair": ([scenes.chair()], [NEAR_BY], SMOOTH),
    "two shapes, two views, one with colours": (
        [scenes.bumpy(2), scenes.soup(6, 1, colored=True)],
        [NEAR_BY, BELOW],
        {"specular": 0.2, "background": (0.2, 0.4, 0.6)},
    ),
    # 1/z differs by 4 tenths of a millionth from one layer to the next, where the margin is 5 tenths: in their order
    # layers 0, 2 and 4 are accepted, though 3 is the first within the margin of the nearest.
    "each layer within the margin of the next": (
        [layers([0.0, 9e-7, 9e-7, 9e-7, 9e-7])],
        [(0.0, 0.0, 2.2)],
        {},
    ),
    "one vertex, two opposite faces": ([STIFF["one vertex, two opposite faces"]], [NEAR_BY, BELOW], FLAT),
    "splinters": ([scenes.stored(scenes.slivers(20, 0.08), np.arange(60))], [NEAR_BY], {}),
    "inside": ([scenes.box()], [INSIDE], {**FLAT, "specular": 0.0}),
    **{
        name: ([STIFF[name]], [view], look)
        for name, view, look in (
            ("across the near plane", (33.0, 21.0, 1.0), {}),
            ("behind the camera", (0.0, 0.0, 2.2), {}),
            ("zero area", NEAR_BY, FLAT),
            ("zero normals", BELOW, {}),
            ("every face twice, reversed", NEAR_BY, {}),
            ("coplanar", (0.0, 0.0, 2.2), {}),
            ("through each other", NEAR_BY, FLAT),
            ("sheets a millionth apart", BELOW, {}),
            ("NaN and infinite vertices", NEAR_BY, {}),
            ("one face edge-on", (0.0, 0.0, 2.2), {}),
            ("far away vertex", (0.0, 0.0, 2.2), FLAT),
        )
    },
}
CLOUDS = {
    "points": ([dotted(30)], [NEAR_BY, BELOW], DOTS),
    "points with colours": ([dotted(9, colored=True)] * 2, [NEAR_BY], {**DOTS, "background": (0.2, 0.4, 0.6)}),
    "points that are not finite": ([scenes.cloud([[np.nan, 0, 0], [0, np.inf, 0], [0.1, 0.2, 0.3]])], [BELOW], DOTS),
}
CASES = MESHES | CLOUDS
IN_PARTS = ("one vertex, two opposite faces", "points")
SIZE = 6


def drawn(shapes, views, changes) -> dict[str, np.ndarray]:
    """Return pictures, geometry and gradients, all through the one call."""
    leaves = cameras(*views, count=len(shapes), grad=True)
    chosen = scenes.look(SIZE, len(shapes), **changes)
    if chosen.light_direction is not None:
        chosen = scenes.look(SIZE, len(shapes), **{**changes, "light_direction": np.repeat(SIDE_LIGHT, len(shapes), 0)})
    with_ids = chosen.kind == "mesh" and chosen.supersample == 1
    images = render(pack(shapes), leaves, chosen, outputs=("geometry",) if with_ids else ())
    (images.rgb * torch.linspace(-1, 1, 3 * SIZE * SIZE).reshape(3, SIZE, SIZE)).sum().backward()
    slopes = torch.stack([leaves.azimuth_deg.grad, leaves.elevation_deg.grad, leaves.distance.grad], -1)
    found = {"rgb": images.rgb.detach().numpy(), "slopes": slopes.numpy()}
    return found | ({"ids": images.face_ids, "depth": images.depth, "normals": images.normals} if with_ids else {})


def kept_and_alone() -> dict[str, np.ndarray]:
    """Return what is drawn of kept views, and by the gradient without silhouettes."""
    shape, views, look = scenes.icosahedron(), cameras(NEAR_BY), scenes.look(SIZE)
    batch = kept_batch([shape], ["0"], ViewKeeper(None, None))
    leaves = cameras(NEAR_BY, grad=True)
    render(pack([shape]), leaves, look, gradient="shading").rgb.sum().backward()
    return {"kept": render(batch, views, look, gradient="none").rgb.numpy(), "shading": leaves.azimuth_deg.grad.numpy()}


def everything() -> dict[str, np.ndarray]:
    """Return all of all cases, by case and name."""
    found = {f"{case}/{name}": value for case in CASES for name, value in drawn(*CASES[case]).items()}
    return found | {f"more/{name}": value for name, value in kept_and_alone().items()}


def simulate(path: str) -> None:
    """Write what the CUDA kernels draw, run by the simulator on tensors in main memory."""
    # The simulator waits for its threads by asking again and again; each gets its turn sooner.
    sys.setswitchinterval(1e-5)
    scene.is_gpu = lambda device: True
    snap = raster.snap
    # CUDA's max takes the other argument where one is NaN; Python can't floor a NaN.
    raster.snap = lambda value: snap(value) if value == value else -int(raster.LIMIT)
    with np.errstate(all="ignore"):
        found = everything()
        from mvtn_cli.core.render.gpu import mesh, points

        mesh.HELD = points.HELD = 1
        found |= {f"{case} in parts/{name}": value for case in IN_PARTS for name, value in drawn(*CASES[case]).items()}
    np.savez(path, **found)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    path = tmp_path_factory.mktemp("cuda") / "simulated.npz"
    switches = {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parents[1])}
    command = [sys.executable, __file__, str(path)]
    done = subprocess.run(command, env=os.environ | switches, capture_output=True, text=True, timeout=230, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    with np.load(path) as arrays:
        return dict(arrays)


@pytest.fixture(scope="module")
def on_cpu():
    return everything()


@pytest.mark.parametrize("case", MESHES)
def test_the_same_faces_are_seen(case, simulated, on_cpu):
    """Also where faces lie within the margin of each other, and their order decides."""
    for name in ("ids", "depth", "normals"):
        if (key := f"{case}/{name}") in on_cpu:
            np.testing.assert_allclose(simulated[key], on_cpu[key], rtol=1e-6, atol=0 if name == "ids" else 1e-6)


@pytest.mark.parametrize("case", CASES)
def test_pictures_are_the_same(case, simulated, on_cpu):
    np.testing.assert_allclose(simulated[f"{case}/rgb"], on_cpu[f"{case}/rgb"], rtol=0, atol=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_gradients_are_the_same(case, simulated, on_cpu):
    expected = on_cpu[f"{case}/slopes"]
    largest = np.abs(expected).max(axis=(0, 1))
    assert (np.abs(simulated[f"{case}/slopes"] - expected) <= 2e-4 * largest + 1e-12).all()


def test_kept_views_and_the_gradient_of_shading_are_the_same(simulated, on_cpu):
    np.testing.assert_allclose(simulated["more/kept"], on_cpu["more/kept"], atol=1e-6)
    np.testing.assert_allclose(simulated["more/shading"], on_cpu["more/shading"], rtol=2e-4)


@pytest.mark.parametrize("case", IN_PARTS)
def test_views_drawn_one_at_a_time_have_the_same_bytes(case, simulated):
    for name in ("rgb", "slopes"):
        np.testing.assert_array_equal(simulated[f"{case} in parts/{name}"], simulated[f"{case}/{name}"])


def test_the_cases_see_something_and_pull(on_cpu):
    """Else the comparisons above would hold for pictures of nothing."""
    blank = {"behind the camera", "one face edge-on"}
    for case in CASES.keys() - blank:
        assert np.ptp(on_cpu[f"{case}/rgb"]) > 0.02 and np.abs(on_cpu[f"{case}/slopes"]).max() > 0
    assert set(np.unique(on_cpu["each layer within the margin of the next/ids"])) == {-1, 4}


if __name__ == "__main__":
    simulate(sys.argv[1])
