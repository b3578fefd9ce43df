from __future__ import annotations

import base64
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from mvtn_cli.core.reporting.gather import gather, read_solids
from mvtn_cli.core.reporting.viewer import normals, viewer_section

sys.path.insert(0, str(Path(__file__).parent))
from made_up import make_run

CLASSES = ["chair", "sofa", "table", "lamp"]


@pytest.fixture
def folder(tmp_path) -> Path:
    return make_run(tmp_path / "run", CLASSES, num_views=10, size=16, skill=2.0)


def test_the_numbers_of_the_viewer_are_those_of_the_files(folder):
    findings = gather(folder)
    section = viewer_section(findings)
    assert section is not None and section["has_start"]
    document = json.loads(section["data"])
    assert len(document["colors"]) == 10 and all(color.startswith("#") for color in document["colors"])
    assert findings.best is not None
    first = document["shapes"][0]
    cameras = np.array(first["cameras"])
    assert np.allclose(cameras[:, 0], findings.best.azimuth_deg[0], atol=0.006) and (cameras[:, 2] == 2.2).all()
    solid = findings.solids[findings.best.names[0]]
    vertices = np.frombuffer(base64.b64decode(first["vertices"]), "<i2").reshape(-1, 3) / 32767
    assert np.allclose(vertices, solid.vertices, atol=2e-5)
    faces = np.frombuffer(base64.b64decode(first["faces"]), "<u2").reshape(-1, 3)
    assert np.array_equal(faces, solid.faces)
    assert set(document["shapes"][1]) == {"points", "normals", "cameras", "start"}


def test_mistakes_say_what_they_were_taken_for_and_come_once(folder):
    findings = gather(folder)
    names = viewer_section(findings)["names"]
    wrong = [m for m in findings.result["mistakes"] if m["name"] not in findings.best.names]
    assert len(names) == len(findings.solids) == len(set(names)) and wrong
    assert names[8] == f"{wrong[0]['label']}: {wrong[0]['name'].split('/')[1]}, taken for {wrong[0]['predicted']}"


def test_views_that_have_not_moved_have_no_start_to_show(tmp_path):
    section = viewer_section(gather(make_run(tmp_path / "run", CLASSES, learned=False, size=16)))
    assert not section["has_start"] and json.loads(section["data"])["colors"][0] == "--v0"


def test_a_file_that_is_not_one_of_these_is_no_viewer(folder):
    path = folder / "shapes.npz"
    with np.load(path) as arrays:
        kept = dict(arrays)
    np.savez(path, **{**kept, "faces": kept["faces"] + 5000})
    assert read_solids(path) == {}
    np.savez(path, **{**kept, "vertex_counts": kept["vertex_counts"][:-1]})
    assert read_solids(path) == {}
    path.write_bytes(b"PK")
    assert read_solids(path) == {} and viewer_section(gather(folder)) is None


def test_normals_of_points_on_a_plane_and_on_a_ball():
    random = np.random.default_rng(0)
    plane = np.c_[random.uniform(-1, 1, (300, 2)), np.zeros(300)]
    assert np.allclose(np.abs(normals(plane)[:, 2]), 1)
    ball = random.normal(size=(1000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    assert np.abs((normals(ball) * ball).sum(axis=1)).mean() > 0.98
    assert np.array_equal(normals(plane[:2]), [[0, 1, 0], [0, 1, 0]])
