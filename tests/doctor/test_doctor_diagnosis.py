"""Each way in which a data set can be ill is found, and a healthy one is called healthy."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import numpy as np
import pytest
from release_writers import (
    box_off,
    core_v2,
    objects_file,
    objects_release,
    off_release,
    put,
    resampled_release,
    scan,
    scans_release,
    shapenet_rows,
    write_list,
)

from mvtn_cli.console import Console
from mvtn_cli.core.datasets import open_dataset, survey
from mvtn_cli.core.datasets.official import OFFICIAL, Official
from mvtn_cli.core.preprocess import mapping
from mvtn_cli.core.preprocess.diagnosis import Check, Diagnosis, count_table, diagnose
from mvtn_cli.core.preprocess.examination import examine, examine_all
from mvtn_cli.core.shapes import read_shape

QUIET = Console(err=io.StringIO(), quiet=True)
SMALL = {"bed": {"train": 3, "test": 2}, "chair": {"train": 2, "test": 1}}
FLIPPED = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n"


def look(spec: str | Path) -> Diagnosis:
    dataset = survey(str(spec))
    return diagnose(dataset, examine_all(dataset.items, QUIET, 1))


def check(diagnosis: Diagnosis, name: str) -> Check:
    return next(check for check in diagnosis.checks if check.name == name)


@pytest.fixture
def small_modelnet(monkeypatch) -> None:
    """Let ModelNet have two classes and eight shapes."""
    official = Official({"train": 5, "test": 3}, SMALL, numbered=True)
    monkeypatch.setitem(OFFICIAL, "modelnet40", official)
    monkeypatch.setitem(
        OFFICIAL, "modelnet40-hdf5", Official({"train": 5, "test": 3}, SMALL, 1, "one is known to lack")
    )


def release(root: Path) -> Path:
    return off_release(root, {"bed": (3, 2), "chair": (2, 1)})


@pytest.mark.usefixtures("small_modelnet")
def test_a_whole_release_with_glued_headers_is_healthy(tmp_path):
    diagnosis = look(f"modelnet40:{release(tmp_path)}")
    assert diagnosis.bad == []
    assert {check.state for check in diagnosis.checks} == {"ok"}
    rows = count_table(diagnosis)
    assert rows == [
        {"class": "bed", "counts": {"train": 3, "val": 0, "test": 2}, "official": SMALL["bed"]},
        {"class": "chair", "counts": {"train": 2, "val": 0, "test": 1}, "official": SMALL["chair"]},
        {"class": "all", "counts": {"train": 5, "val": 0, "test": 3}, "official": {"train": 5, "test": 3}},
    ]
    assert check(diagnosis, "mended").count == 8  # each box has a face without area
    assert "8 repeated-index-faces" in check(diagnosis, "mended").detail


@pytest.mark.usefixtures("small_modelnet")
def test_missing_official_shapes_are_counted_and_named(tmp_path):
    (release(tmp_path) / "bed" / "train" / "bed_0002.off").unlink()
    diagnosis = look(f"modelnet40:{tmp_path}")
    assert diagnosis.bad == ["official counts"]
    found = check(diagnosis, "official counts")
    assert found.count == 1 and "bed train 2 of 3" in found.detail and "as bed_0002" in found.detail
    shutil.rmtree(tmp_path / "chair")
    rows = count_table(look(f"modelnet40:{tmp_path}"))
    assert rows[1] == {"class": "chair", "counts": {"train": 0, "val": 0, "test": 0}, "official": SMALL["chair"]}


@pytest.mark.usefixtures("small_modelnet")
def test_shapes_too_many_are_worth_a_warning_and_another_split_is_worse(tmp_path):
    put(release(tmp_path) / "bed" / "test" / "bed_0006.off", box_off(9))
    diagnosis = look(f"modelnet40:{tmp_path}")
    assert diagnosis.bad == [] and check(diagnosis, "official counts").state == "warn"
    (tmp_path / "bed" / "test" / "bed_0006.off").unlink()
    (tmp_path / "bed" / "test" / "bed_0004.off").rename(tmp_path / "bed" / "train" / "bed_0004.off")
    (tmp_path / "bed" / "train" / "bed_0001.off").rename(tmp_path / "bed" / "test" / "bed_0001.off")
    diagnosis = look(f"modelnet40:{tmp_path}")
    assert diagnosis.bad == ["official split"]
    assert check(diagnosis, "official split").count == 2


@pytest.mark.usefixtures("small_modelnet")
def test_what_the_distribution_itself_lacks_is_no_fault(tmp_path):
    objects_file(tmp_path / "ply_data_train0.h5", [0, 0, 1, 1], seed=5)
    objects_file(tmp_path / "ply_data_test0.h5", [0, 0, 1], seed=50)
    put(tmp_path / "shape_names.txt", "bed\nchair\n")
    diagnosis = look(f"modelnet40:{tmp_path}")
    assert diagnosis.bad == [] and "one is known to lack" in check(diagnosis, "official counts").detail
    objects_file(tmp_path / "ply_data_train0.h5", [0, 1, 1], seed=7)
    assert look(f"modelnet40:{tmp_path}").bad == ["official counts"]


def test_real_official_counts_make_a_tiny_copy_incomplete(tmp_path):
    names = ("airplane", "night_stand")
    rows = {"train": ["airplane_0001", "night_stand_0001"], "test": ["airplane_0627", "night_stand_0201"]}
    diagnosis = look(resampled_release(tmp_path, rows, names))
    assert diagnosis.bad == ["official counts"]
    assert check(diagnosis, "official counts").count == 12311 - 4
    assert check(diagnosis, "official split").state == "ok"
    assert len(count_table(diagnosis)) == 41


def test_unreadable_and_empty_shapes_are_named_with_the_reason(tmp_path):
    release(tmp_path)
    put(tmp_path / "bed" / "train" / "bed_0001.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n")
    put(tmp_path / "bed" / "train" / "bed_0002.off", "")
    put(tmp_path / "bed" / "test" / "bed_0004.off", "OFF\n3 1 0\n1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n")
    diagnosis = look(f"folder:{tmp_path}")
    assert diagnosis.bad == ["unreadable", "empty"]
    assert [(item.name, found.reason) for item, found in diagnosis.items("unreadable")] == [
        ("bed/bed_0001", "line 1: the header declares 3 vertices and 1 faces, but only 2 lines follow (truncated?)"),
        ("bed/bed_0002", "is empty (0 bytes)"),
    ]
    ((item, found),) = diagnosis.items("empty")
    assert item.name == "bed/bed_0004" and found.reason.startswith("single-point")


def test_whatever_a_reader_raises_is_a_finding_and_ctrl_c_is_not():
    item = open_dataset("builtin:shapes?train=1&test=1").items[0]

    def broken() -> None:
        raise RecursionError("too\ndeep")

    def stopped() -> None:
        raise KeyboardInterrupt

    found = examine(item.__class__(**{**vars(item), "read": broken}))
    assert (found.state, found.reason) == ("unreadable", "RecursionError too deep")
    with pytest.raises(KeyboardInterrupt):
        examine(item.__class__(**{**vars(item), "read": stopped}))


def test_duplicates_across_splits_are_bad_within_one_worth_a_warning(tmp_path):
    release(tmp_path)
    text = (tmp_path / "bed" / "train" / "bed_0001.off").read_text()
    diagnosis = look(f"folder:{tmp_path}")
    assert diagnosis.bad == [] and diagnosis.duplicates == ()
    put(tmp_path / "bed" / "train" / "again.off", reordered(text))
    diagnosis = look(f"folder:{tmp_path}")
    assert diagnosis.bad == []
    assert check(diagnosis, "duplicates within a split").count == 2
    put(tmp_path / "chair" / "test" / "moved.off", moved(text))
    diagnosis = look(f"folder:{tmp_path}")
    assert diagnosis.bad == ["duplicates across splits"]
    assert check(diagnosis, "duplicates across splits").count == 3
    assert check(diagnosis, "duplicates of two classes").state == "warn"
    assert {item.name for item in diagnosis.duplicates[0].items} == {"bed/bed_0001", "bed/again", "chair/moved"}


def reordered(text: str) -> str:
    """The same box with its corners the other way round, written with CRLF."""
    lines = text.splitlines()
    corners = lines[2:10][::-1]
    faces = [" ".join([row.split()[0], *(str(7 - int(i)) for i in row.split()[1:])]) for row in lines[10:]]
    return "\r\n".join([*lines[:2], *corners, *faces]) + "\r\n"


def moved(text: str) -> str:
    """The same box, four times as large and elsewhere."""
    lines = text.splitlines()
    corners = [" ".join(f"{4 * float(value) + 16}" for value in line.split()) for line in lines[2:10]]
    return "\n".join([*lines[:2], *corners, *lines[10:]]) + "\n"


def test_the_helpers_above_keep_the_shape(tmp_path):
    text = box_off(1.1)
    original = read_shape(put(tmp_path / "a.off", text))
    assert np.array_equal(read_shape(put(tmp_path / "b.off", reordered(text))).vertices, original.vertices[::-1])
    assert np.allclose(read_shape(put(tmp_path / "c.off", moved(text))).vertices, 4 * original.vertices + 16)


def test_equal_rows_of_two_files_are_duplicates(tmp_path):
    objects_release(tmp_path)
    train = tmp_path / "main_split_nobg" / "training_objectdataset.h5"
    objects_file(train, [0, 4, 14, 4], points=20, seed=1)
    objects_file(tmp_path / "main_split_nobg" / "test_objectdataset.h5", [1, 4, 14, 4], points=20, seed=1)
    diagnosis = look(f"scanobjectnn:{tmp_path}@obj_only")
    assert check(diagnosis, "duplicates across splits").count == 8
    assert check(diagnosis, "duplicates of two classes").count == 2


def test_labels_out_of_range_are_counted(tmp_path):
    objects_release(tmp_path)
    objects_file(tmp_path / "main_split_nobg" / "test_objectdataset.h5", [4, 15, 200])
    diagnosis = look(f"scanobjectnn:{tmp_path}")
    found = check(diagnosis, "labels")
    assert (found.state, found.count) == ("bad", 2) and "0 to 200, 15 classes" in found.detail


def test_inside_out_meshes_are_named_and_do_no_harm(tmp_path):
    release(tmp_path)
    put(tmp_path / "bed" / "train" / "flipped.off", FLIPPED)
    diagnosis = look(f"folder:{tmp_path}")
    assert diagnosis.bad == []
    found = check(diagnosis, "winding")
    assert (found.state, found.count) == ("warn", 1) and "bed/flipped" in found.detail


def test_shapes_read_with_the_wrong_axis_get_a_hint(tmp_path):
    for item in open_dataset("builtin:shapes?train=24&test=12").items:
        shape = item.read()
        lines = [f"{x:.9g} {-z:.9g} {y:.9g}" for x, y, z in shape.vertices]
        faces = ["3 " + " ".join(map(str, face)) for face in shape.faces]
        name, stem = item.name.split("/")
        text = "\n".join(["OFF", f"{len(lines)} {len(faces)} 0", *lines, *faces])
        put(tmp_path / name / item.split / f"{stem}.off", text)
    wrong, right = (check(look(f"folder:{tmp_path}{tail}"), "up axis") for tail in ("", "?up=z"))
    assert wrong.state == "warn" and "z up" in wrong.detail and "?up=z" in wrong.detail
    assert right.state == "ok" and right.detail.startswith("y")


def test_listed_shapes_that_are_not_there_are_bad_but_for_those_that_v2_lacks(tmp_path, monkeypatch):
    rows = shapenet_rows(each=8)
    write_list(tmp_path / "all.csv", rows)
    core_v2(tmp_path, rows)
    monkeypatch.setitem(OFFICIAL, "shapenet55-v2", Official({"train": 18, "val": 3, "test": 3}, {}, 1, "one of them"))
    assert look(tmp_path).bad == []
    shutil.rmtree(tmp_path / rows[0][1] / rows[0][3])
    diagnosis = look(tmp_path)
    assert diagnosis.bad == [] and check(diagnosis, "listed shapes").state == "warn"
    shutil.rmtree(tmp_path / rows[8][1])  # a whole synset: opening refuses, the doctor counts
    diagnosis = look(tmp_path)
    assert diagnosis.bad == ["official counts", "listed shapes"]
    assert check(diagnosis, "listed shapes").count == 9


def test_scans_without_an_object_are_unreadable(tmp_path):
    put(scans_release(tmp_path) / "object_dataset" / "bag" / "005_00020.bin", scan(9, (0, 1, 2)))
    diagnosis = look(f"scanobjectnn:{tmp_path}")
    assert "unreadable" in diagnosis.bad
    assert "no point of the object" in diagnosis.items("unreadable")[0][1].reason
    assert "unreadable" not in look(f"scanobjectnn:{tmp_path}@with_bg").bad


def test_classes_without_test_shapes_and_sets_without_labels(tmp_path):
    put(release(tmp_path) / "sofa" / "train" / "1.off", box_off(3))
    found = check(look(f"folder:{tmp_path}"), "classes in splits")
    assert found.state == "warn" and found.detail == "sofa has no test"
    diagnosis = look(f"{tmp_path}/bed/*/*.off")
    assert diagnosis.bad == [] and "none" in check(diagnosis, "labels").detail


def test_several_processes_find_the_same(monkeypatch):
    items = open_dataset("builtin:shapes?train=20&test=10").items
    alone = examine_all(items, QUIET, 1)
    monkeypatch.setattr(mapping, "START_UP_S", 0.0)
    assert examine_all(items, QUIET, 2) == alone
    assert {found.state for found in alone} == {"ok"}
