from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from mvtn_cli.config import EvalConfig
from mvtn_cli.console import Console
from mvtn_cli.core.evaluation.evaluate import evaluate_run
from mvtn_cli.core.evaluation.shown_shapes import MAX_POINTS, MAX_VERTICES, save_shapes
from mvtn_cli.core.store import StoredShape

sys.path.insert(0, str(Path(__file__).parent))
from test_evaluate_run import run, toy  # noqa: F401  the fixture


def fine_ball() -> StoredShape:
    """A ball of 40 × 41 vertices, each of them twice, as where a crease splits them."""
    a, e = np.meshgrid(np.linspace(0, 2 * np.pi, 41)[:-1], np.linspace(-1.5, 1.5, 41), indexing="ij")
    ball = np.stack([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)], axis=-1).reshape(-1, 3)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(40), np.arange(40), indexing="ij"))
    one, two, three, four = i * 41 + j, (i + 1) % 40 * 41 + j, (i + 1) % 40 * 41 + j + 1, i * 41 + j + 1
    faces = np.concatenate([np.stack([one, two, three], 1), np.stack([one, three, four], 1) + len(ball)])
    vertices = np.tile(ball, (2, 1)).astype(np.float32)
    return StoredShape(
        vertices, faces.astype(np.int32), vertices, None, vertices[:2000].copy(), None, np.zeros(3), 1.0
    )  # fmt: skip


def cloud() -> StoredShape:
    none = np.zeros((0, 3), np.float32)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (1500, 3)).astype(np.float32)
    return StoredShape(none, none.astype(np.int32), none, None, points, None, np.zeros(3), 1.0)


def test_meshes_are_made_small_and_closed_again_and_clouds_stay_points(tmp_path):
    shapes = [fine_ball(), cloud()]
    prepared = SimpleNamespace(
        records=[SimpleNamespace(name="ball"), SimpleNamespace(name="cloud")], load=lambda i: shapes[i]
    )
    save_shapes(tmp_path / "s.npz", prepared, ["cloud", "ball", "cloud", "elsewhere"], Console(quiet=True))
    with np.load(tmp_path / "s.npz") as kept:
        assert kept["names"].tolist() == ["cloud", "ball"]
        assert kept["point_counts"].tolist() == [MAX_POINTS, 0] and kept["vertex_counts"][0] == 0
        assert np.array_equal(kept["points"], shapes[1].points[:MAX_POINTS])
        vertices, faces = kept["vertices"], kept["faces"].astype(int)
    assert 100 < len(vertices) <= MAX_VERTICES and np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < 0.1
    edges, count = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_counts=True)
    assert (count == 1).sum() <= 2 * 40 and len(edges) > 200, "torn only at the two open ends, not at every face"
    save_shapes(tmp_path / "s.npz", prepared, ["elsewhere"], Console(quiet=True))
    assert not (tmp_path / "s.npz").exists(), "a file of an earlier evaluation would tell of other shapes"


def test_an_evaluation_keeps_the_shapes_of_its_pictures(run):  # noqa: F811
    result = evaluate_run(run, toy(), EvalConfig(device="cpu"), Console(quiet=True))
    with np.load(run.path / "shapes.npz") as kept:
        assert kept["names"].tolist() == [mistake["name"] for mistake in result["mistakes"]]
        assert (kept["face_counts"] == 8).all(), "a double pyramid is small enough"
