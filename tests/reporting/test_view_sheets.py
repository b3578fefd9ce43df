from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from mvtn_cli.console import Console
from mvtn_cli.core.render import pack
from mvtn_cli.core.reporting import render_views
from mvtn_cli.core.reporting.camera_files import as_drawn
from mvtn_cli.core.reporting.file_names import safe_name, write_document
from mvtn_cli.core.reporting.shape_files import Subject, caption, write_shape
from mvtn_cli.core.reporting.view_cameras import Placed, given_cameras
from mvtn_cli.core.reporting.view_sheets import chosen_shapes
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.views import Cameras, layouts
from mvtn_cli.errors import DataError, MvtnError
from mvtn_cli.render_views_config import RenderViewsConfig


def tetrahedron() -> StoredShape:
    vertices = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32) / np.float32(3**0.5)
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32)
    return StoredShape(vertices, faces, vertices.copy(), None, vertices.copy(), None, np.array([1.0, 2.0, 3.0]), 4.0)


def cloud() -> StoredShape:
    mesh = tetrahedron()
    return replace(mesh, vertices=mesh.vertices[:0], faces=mesh.faces[:0], normals=mesh.normals[:0])


def prepared(
    names: list[str], labels: list[int] | None = None, split: str = "test", clouds: tuple[int, ...] = ()
) -> SimpleNamespace:
    records = [
        SimpleNamespace(name=n, label=-1 if labels is None else labels[i], split=split, source=f"/in/{n}")
        for i, n in enumerate(names)
    ]
    return SimpleNamespace(
        spec="toy",
        classes=() if labels is None else ("a", "b"),
        records=records,
        load=lambda i: cloud() if i in clouds else tetrahedron(),
        split=lambda name: [i for i, r in enumerate(records) if r.split == name],
    )


def drawn(shapes: SimpleNamespace, out: Path, **settings) -> list[dict]:
    config = RenderViewsConfig(**{"out": out, "image_size": 24, **settings})
    return list(render_views([shapes], config, Console(quiet=True)))


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


def test_a_learned_light_is_written_down_and_draws_the_same_again(tmp_path):
    light = torch.nn.functional.normalize(torch.tensor([[[0.9, 0.3, -0.2], [-0.5, 1.0, 0.1]]]), dim=-1)
    config = RenderViewsConfig(image_size=24, num_views=2, cameras=True, out=tmp_path / "again")
    cameras = as_drawn(Cameras.at([10.0, 200.0], [20.0, -30.0]))
    about = {"name": "a", "center": [0.0, 0.0, 0.0], "radius": 1.0}
    subject = Subject("a", pack([tetrahedron()]), "mesh", Placed(cameras, light), about)
    first = write_shape(tmp_path, subject, config, config)
    (again,) = drawn(prepared(["a"]), tmp_path / "again", cameras_from=first["transforms"], per_view=True)
    plain = write_shape(tmp_path / "plain", replace(subject, placed=Placed(cameras)), config, config)
    pictures = [[Path(view["picture"]).read_bytes() for view in a["views"]] for a in (first, again, plain)]
    assert pictures[0] == pictures[1] != pictures[2]


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
    assert safe_name("cameras.json", taken) == "shape-cameras.json"


def test_safe_names_do_not_meet_on_any_file_system():
    taken: set[str] = set()
    names = ["caf\u00e9", "CAF\u00c9", "cafe\u0301"]
    assert [safe_name(name, taken) for name in names] == ["caf\u00e9", "CAF\u00c9-2", "caf\u00e9-3"]
    assert safe_name("a.png", taken) == "a.png"  # its folder is what the sheet of `a` would be
    assert safe_name("a", taken) == "a-2"
    assert safe_name("b", taken) == "b"
    assert safe_name("b.png", taken) == "b.png-2"
    long = [safe_name("\u6905" * 85 + end, taken) for end in ("1", "2")]
    assert len(set(long)) == 2 and max(len(name.encode()) for name in long) < 130


def test_documents_hold_a_row_of_numbers_on_a_line_and_any_file_name(tmp_path):
    document = {
        "rows": [[1.0, -2.5e-17], [3, 4]],
        "words": ["1, 2", "[ 3 ]"],
        "none": [None, 1.5],
        "file": "\udcff.off",
    }
    write_document(tmp_path / "x.json", document)
    text = (tmp_path / "x.json").read_text(encoding="utf-8")
    assert json.loads(text) == document
    assert "[1.0, -2.5e-17]" in text and "[3, 4]" in text


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
    config = RenderViewsConfig(out=tmp_path, image_size=16, num_views=1)
    answers = render_views([prepared(["a", "b"])], config, Console(quiet=True))
    first = next(answers)
    assert Path(first["picture"]).is_file() and not (tmp_path / "b.png").exists()


def test_a_part_is_asked_for_when_all_before_it_is_drawn(tmp_path):
    config = RenderViewsConfig(out=tmp_path, image_size=16, num_views=1)
    asked = []

    def parts():
        for name in "ab":
            asked.append(name)
            yield prepared([name, name])

    answers = render_views(parts(), config, Console(quiet=True), total=4)
    names = [(Path(answer["picture"]).name, "".join(asked)) for answer in answers]
    assert names == [("a.png", "a"), ("a-2.png", "a"), ("b.png", "ab"), ("b-2.png", "ab")]


def test_an_early_end_keeps_the_cameras_of_what_was_drawn(tmp_path):
    config = RenderViewsConfig(out=tmp_path, image_size=16, num_views=1)
    answers = render_views([prepared(["a", "b"])], config, Console(quiet=True))
    first = next(answers)
    answers.close()
    assert json.loads((tmp_path / "cameras.json").read_text())["shapes"] == [first]


def test_without_wishes_there_is_the_sheet_and_nothing_else(tmp_path):
    drawn(prepared(["a"]), tmp_path / "out", num_views=1)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a.png", "cameras.json"]


def test_every_path_of_an_answer_is_a_file_and_every_file_is_in_an_answer(tmp_path):
    wishes = {"outputs": "silhouette,depth,normals,arrays", "cameras": True, "turntable": True}
    (answer,) = drawn(prepared(["a"]), tmp_path / "out", num_views=2, **wishes)
    named = [value for key, value in answer.items() if key not in ("file", "name", "label", "views")]
    named += [view[key] for view in answer["views"] for key in ("picture", "silhouette", "depth", "normals")]
    files = {str(path) for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert len(set(named)) == len(named) and set(named) | {str(tmp_path / "out" / "cameras.json")} == files
    with np.load(answer["arrays"], allow_pickle=False) as arrays:
        assert arrays["rgb"].shape == (2, 3, 24, 24) and arrays["depth"].dtype == np.float32
        assert np.array_equal(arrays["silhouette"], arrays["face_ids"] >= 0)
        assert np.array_equal(arrays["silhouette"], arrays["depth"] > 0)
        assert (arrays["center"].tolist(), float(arrays["radius"])) == ([1, 2, 3], 4)


def test_a_sheet_shows_the_outputs_of_each_view_below_it(tmp_path):
    (plain,) = drawn(prepared(["a"]), tmp_path / "one", num_views=8)
    (more,) = drawn(prepared(["a"]), tmp_path / "two", num_views=8, outputs="silhouette,normals")
    with Image.open(plain["picture"]) as one, Image.open(more["picture"]) as two:
        assert two.height - one.height == 2 * 2 * (96 + 4)  # two rows of views, two more rows below each
        assert two.width > one.width  # their names stand on the left


def test_a_sheet_of_many_tiles_is_about_square_and_one_of_few_is_a_row(tmp_path):
    def proportion(views: int, outputs: tuple[str, ...]) -> float:
        (answer,) = drawn(prepared(["a"]), tmp_path / f"{views}", num_views=views, outputs=outputs)
        with Image.open(answer["picture"]) as sheet:
            return sheet.width / sheet.height

    assert proportion(6, ()) > 3
    assert 0.6 < proportion(100, ("depth",)) < 1.6
    assert 0.6 < proportion(20, ("silhouette", "depth", "normals")) < 1.6


@pytest.mark.parametrize(
    ("azimuth", "words"),
    [(-180.0, "180° / 30°"), (-179.6, "180° / 30°"), (-179.4, "\u2212179° / 30°"), (0.2, "0° / 30°")],
)
def test_from_behind_is_180_degrees(azimuth: float, words: str):
    assert caption(azimuth, 30.0) == words


def test_normals_of_points_are_refused_for_that_shape_alone(tmp_path):
    heard = io.StringIO()
    config = RenderViewsConfig(out=tmp_path, image_size=16, num_views=1, outputs=("normals", "depth"))
    shapes = prepared(["a", "b", "c"], clouds=(1,))
    a, b, c = render_views([shapes], config, Console(err=heard))
    assert "normals" in a["views"][0] and "normals" in c["views"][0]
    assert b["error"] == "points have no normals; leave normals out of --outputs" and "picture" not in b
    assert "warning: /in/b: points have no normals" in heard.getvalue()
    assert len(json.loads((tmp_path / "cameras.json").read_text())["shapes"]) == 2
    (drawn_points,) = drawn(prepared(["b"], clouds=(0,)), tmp_path / "two", num_views=1, outputs="silhouette,depth")
    assert {"silhouette", "depth"} < set(drawn_points["views"][0])


def test_a_picture_that_cannot_be_written_ends_the_work_with_its_name_and_a_way_out(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a").write_text("in the way")
    with pytest.raises(MvtnError, match=r"can't write .*view_01\.png") as caught:
        drawn(prepared(["a"]), tmp_path / "out", num_views=1, per_view=True)
    assert "--out" in caught.value.hint
    assert json.loads((tmp_path / "out" / "cameras.json").read_text())["shapes"] == []
