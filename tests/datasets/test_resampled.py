"""ModelNet as text with normals."""

from __future__ import annotations

import pickle
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from release_writers import point_lines, put, resampled_release

from mvtn_cli.core.datasets import open_dataset, survey
from mvtn_cli.errors import DataError

NAMES = ("airplane", "bed", "night_stand")
TRAIN = ("airplane_0001", "airplane_0002", "bed_0001", "night_stand_0001", "bed_0002", "night_stand_0002")
ROWS = {"train": TRAIN, "test": ("airplane_0627", "bed_0516", "night_stand_0201")}


def release(root: Path) -> Path:
    return resampled_release(root, ROWS, NAMES)


def refusal(spec: str) -> str:
    with pytest.raises(DataError) as error:
        open_dataset(spec)
    return f"{error.value.message} | {error.value.hint}"


def test_the_lists_decide_and_a_class_name_may_hold_underscores(tmp_path):
    dataset = open_dataset(f"modelnet40:{release(tmp_path)}")
    assert dataset.classes == NAMES
    assert {item.name: (item.label, item.split) for item in dataset.items} == {
        **{f"{shape.rpartition('_')[0]}/{shape}": (NAMES.index(shape.rpartition("_")[0]), "train") for shape in TRAIN},
        "airplane/airplane_0627": (0, "test"),
        "bed/bed_0516": (1, "test"),
        "night_stand/night_stand_0201": (2, "test"),
    }
    assert "normal_resampled" in dataset.title and "6 train, 3 test" in dataset.title


def test_all_points_are_read_as_they_stand_and_normals_are_not_taken_for_colours(tmp_path):
    item = open_dataset(str(release(tmp_path))).items[0]
    expected = np.loadtxt(tmp_path / "airplane" / "airplane_0001.txt", delimiter=",")
    shape = pickle.loads(pickle.dumps(item)).read()
    assert np.array_equal(shape.points, expected[:, :3])  # y up already: nothing is turned
    assert shape.point_colors is None and shape.is_cloud


def test_a_plain_path_and_one_more_folder_are_recognised(tmp_path):
    release(tmp_path / "more" / "modelnet40_normal_resampled")
    for path in (tmp_path / "more", tmp_path / "more" / "modelnet40_normal_resampled"):
        dataset = open_dataset(str(path))
        assert dataset.spec == f"modelnet40:{path}"
        assert open_dataset(dataset.spec).items == dataset.items


def test_modelnet10_has_lists_of_its_own_or_is_taken_out_of_the_forty(tmp_path):
    release(tmp_path)
    taken = open_dataset(f"modelnet10:{tmp_path}")
    assert taken.classes == ("bed", "night_stand")
    assert Counter(item.split for item in taken.items) == {"train": 4, "test": 2}
    resampled_release(tmp_path, {"train": ["bed_0001"], "test": ["bed_0516"]}, ["bed"], number=10)
    assert open_dataset(f"modelnet10:{tmp_path}").classes == ("bed",)
    assert len(open_dataset(f"modelnet40:{tmp_path}").items) == 9


def test_a_missing_class_is_an_error_that_names_it_and_where_to_get_it(tmp_path):
    for file in (release(tmp_path) / "bed").iterdir():
        file.unlink()
    text = refusal(str(tmp_path))
    assert "lacks class bed: 3 of the 9 listed shapes" in text
    assert "modelnet.cs.princeton.edu" in text and "--explain-layout" in text
    (tmp_path / "bed").rmdir()
    assert refusal(str(tmp_path)) == text
    without = open_dataset(f"modelnet40:{tmp_path}?missing=skip")
    assert without.classes == NAMES and len(without.items) == 6
    assert open_dataset(without.spec).items == without.items
    assert len(survey(str(tmp_path)).missing[0].names) == 3


def test_single_missing_files_are_counted_and_many_are_refused(tmp_path):
    (release(tmp_path) / "bed" / "bed_0001.txt").unlink()
    dataset = open_dataset(str(tmp_path))
    assert "1 listed shapes are not there" in dataset.title
    assert [(part.part, part.names, part.whole) for part in dataset.missing] == [
        ("class bed", ("bed/bed_0001",), False)
    ]
    for name in ("airplane/airplane_0001.txt", "night_stand/night_stand_0001.txt"):
        (tmp_path / name).unlink()
    assert "3 of the 9 listed shapes, the first is" in refusal(str(tmp_path))


@pytest.mark.parametrize("file", ["modelnet40_test.txt", "modelnet40_shape_names.txt"])
def test_a_missing_list_is_named(tmp_path, file):
    (release(tmp_path) / file).unlink()
    assert f"lacks {file}" in refusal(str(tmp_path))


def test_a_list_that_names_no_class_is_refused_with_its_line(tmp_path):
    put(release(tmp_path) / "modelnet40_test.txt", "airplane_0627\n\nzeppelin_0001\n")
    assert "modelnet40_test.txt, line 3: 'zeppelin_0001' belongs to no class" in refusal(str(tmp_path))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: text[:-30], "line 20: a line of x,y,z,nx,ny,nz has"),  # a broken download
        (lambda text: "not-here" + text[text.index(",") :], "line 1: 'not-here' is not a number"),
        (lambda text: "\n".join(line.rpartition(",")[0] for line in text.splitlines()), "has 5 numbers; expected 6"),
        (lambda text: "", "is empty (0 bytes)"),
    ],
)
def test_a_damaged_file_is_refused_with_the_line(tmp_path, damage, words):
    put(release(tmp_path) / "airplane" / "airplane_0001.txt", damage(point_lines(0)))
    with pytest.raises(DataError) as error:
        open_dataset(str(tmp_path)).items[0].read()
    assert words in error.value.message


def test_blank_lines_do_no_harm_and_content_follows_the_bytes(tmp_path):
    items = open_dataset(str(release(tmp_path))).items
    before, points = items[0].content(), items[0].read().points
    put(tmp_path / "airplane" / "airplane_0001.txt", point_lines(0) + "\n\n")
    assert items[0].content() != before
    assert np.array_equal(items[0].read().points, points)
    assert len({item.content() for item in items}) == len(items)
