from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from mvtn_cli.config import RenderViewsConfig
from mvtn_cli.console import Console
from mvtn_cli.core.reporting import render_views
from mvtn_cli.core.reporting.view_sheets import chosen_shapes, given_cameras, safe_name
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.views import layouts
from mvtn_cli.errors import DataError


def tetrahedron() -> StoredShape:
    vertices = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32) / np.float32(3**0.5)
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32)
    return StoredShape(vertices, faces, vertices.copy(), None, vertices.copy(), None, np.zeros(3), 1.0)


def prepared(names: list[str], labels: list[int] | None = None, split: str = "test") -> SimpleNamespace:
    records = [
        SimpleNamespace(name=n, label=-1 if labels is None else labels[i], split=split, source=f"/in/{n}")
        for i, n in enumerate(names)
    ]
    return SimpleNamespace(
        spec="toy",
        classes=() if labels is None else ("a", "b"),
        records=records,
        load=lambda i: tetrahedron(),
        split=lambda name: [i for i, r in enumerate(records) if r.split == name],
    )


def drawn(shapes: SimpleNamespace, out: Path, **settings) -> list[dict]:
    config = RenderViewsConfig(out=out, image_size=24, **settings)
    return list(render_views(shapes, config, Console(quiet=True)))


def test_each_shape_gets_a_sheet_and_all_cameras_are_written_down(tmp_path):
    answers = drawn(prepared(["a.off", "b.off"]), tmp_path / "out", num_views=4)
    for answer in answers:
        with Image.open(answer["picture"]) as sheet:
            assert np.asarray(sheet.convert("L")).std() > 10
        found = [(v["azimuth_deg"], v["elevation_deg"], v["distance"]) for v in answer["views"]]
        azimuth, elevation = layouts("spherical", 4)
        assert np.allclose(found, np.c_[(azimuth + 180) % 360 - 180, elevation, np.full(4, 2.2)], atol=1e-3)
    document = json.loads((tmp_path / "out" / "cameras.json").read_text())
    assert document["shapes"] == answers and document["fov_deg"] == 60


def test_names_stay_inside_the_folder_and_apart(tmp_path):
    names = ["../../escape", "/etc/passwd", "a/b", "a b", "A-B", "..", "cameras", "x" * 300]
    answers = drawn(prepared(names), tmp_path / "out", num_views=1)
    files = [Path(answer["picture"]) for answer in answers]
    assert all(file.parent == tmp_path / "out" and file.is_file() for file in files)
    assert len({file.name.lower() for file in files}) == len(names)
    assert {file.name for file in tmp_path.iterdir()} == {"out"}


def test_safe_names_keep_what_can_be_kept():
    taken: set[str] = set()
    assert safe_name("chair/chair_0001", taken) == "chair-chair_0001"
    assert safe_name("chair/chair_0001", taken) == "chair-chair_0001-2"
    assert safe_name("käse.off", taken) == "käse.off"
    assert safe_name("con", taken) == "shape-con"
    assert safe_name("///", taken) == "shape"


def test_own_cameras_are_taken_as_given():
    config = RenderViewsConfig(azimuth=(0.0, 90.0, 180.0), elevation=(10.0,))
    azimuth, elevation = given_cameras(config, 2)
    assert azimuth.tolist() == [[0, 90, 180]] * 2 and elevation.tolist() == [[10] * 3] * 2
    azimuth, elevation = given_cameras(RenderViewsConfig(azimuth=(15.0,)), 1)
    assert azimuth.tolist() == [[15]] and elevation.tolist() == [[30]]
    azimuth, elevation = given_cameras(RenderViewsConfig(elevation=(-20.0,), num_views=4), 1)
    assert azimuth.tolist() == [[0, 90, 180, 270]] and elevation.tolist() == [[-20] * 4]


def test_random_cameras_differ_between_shapes_and_not_between_runs():
    config = RenderViewsConfig(views="random", num_views=3, seed=4)
    whole, _ = given_cameras(config, 4)
    assert np.array_equal(whole[2:], given_cameras(config, 2, first=2)[0])
    assert len(np.unique(whole)) == 12


def test_single_files_are_all_drawn_and_of_a_data_set_some_of_each_class():
    files = prepared([str(i) for i in range(30)])
    assert chosen_shapes(files, RenderViewsConfig(limit=2)) == list(range(30))
    labelled = prepared([str(i) for i in range(30)], [0] * 25 + [1] * 5)
    chosen = chosen_shapes(labelled, RenderViewsConfig(limit=4))
    assert sorted(labelled.records[i].label for i in chosen) == [0, 0, 1, 1]
    with pytest.raises(DataError, match="split 'val' in toy"):
        chosen_shapes(labelled, RenderViewsConfig(split="val"))


def test_shapes_are_answered_for_as_they_are_drawn(tmp_path):
    answers = render_views(
        prepared(["a", "b"]), RenderViewsConfig(out=tmp_path, image_size=16, num_views=1), Console(quiet=True)
    )
    first = next(answers)
    assert Path(first["picture"]).is_file() and not (tmp_path / "b.png").exists()
