"""Every layout is recognised by what is in the folder, and says how it was understood."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from mvtn_cli.core.datasets import Dataset, open_dataset
from mvtn_cli.errors import DataError, UsageError

TETRAHEDRON = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 2 0\n0 0 3\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"


def tree(root: Path, *names: str) -> Path:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(TETRAHEDRON if path.suffix == ".off" else "")
    return root


def listed(dataset: Dataset) -> dict[str, tuple[str, str]]:
    return {item.name: (dataset.classes[item.label] if item.label >= 0 else "", item.split) for item in dataset.items}


def up_of(dataset: Dataset) -> str:
    """Tell the up axis from the shape itself: the tetrahedron is 3 high along the file's z."""
    height = float(np.ptp(dataset.items[0].read().vertices[:, 1]))
    return {2.0: "y", 3.0: "z"}[height]


def test_class_split_file(tmp_path):
    tree(tmp_path, "cat/train/a.off", "cat/train/b.off", "cat/test/c.off", "ant/train/a.obj", "ant/val/d.ply")
    dataset = open_dataset(str(tmp_path))
    assert dataset.classes == ("ant", "cat")
    assert listed(dataset) == {
        "ant/a": ("ant", "train"),
        "ant/d": ("ant", "val"),
        "cat/a": ("cat", "train"),
        "cat/b": ("cat", "train"),
        "cat/c": ("cat", "test"),
    }
    assert "CLASS/SPLIT/file" in dataset.title
    assert "y up" in dataset.title
    assert "3 train, 1 val, 1 test" in dataset.title


def test_split_class_file(tmp_path):
    tree(tmp_path, "train/cat/a.off", "train/ant/b.off", "test/ant/c.off", "Validation/cat/d.off")
    dataset = open_dataset(f"folder:{tmp_path}")
    assert dataset.classes == ("ant", "cat")
    assert Counter(split for _, split in listed(dataset).values()) == {"train": 2, "test": 1, "val": 1}
    assert "SPLIT/CLASS/file" in dataset.title


def test_class_file_is_split_by_the_hash_of_the_names_class_by_class(tmp_path):
    tree(tmp_path, *(f"{name}/{i:02}.off" for name in ("ant", "bee") for i in range(20)), "cat/only.off")
    dataset = open_dataset(str(tmp_path))
    counts = Counter(listed(dataset).values())
    assert counts == {
        ("ant", "train"): 16,
        ("ant", "test"): 4,
        ("bee", "train"): 16,
        ("bee", "test"): 4,
        ("cat", "train"): 1,
    }
    assert "hash" in dataset.title
    elsewhere = tree(tmp_path / "again", *(f"{name}/{i:02}.off" for name in ("bee", "ant") for i in range(20)))
    again = listed(open_dataset(str(elsewhere)))
    assert again == {name: value for name, value in listed(dataset).items() if not name.startswith("cat")}


def test_hidden_files_macosx_and_unreadable_ones_are_passed_over(tmp_path):
    tree(tmp_path, "a/train/1.off", "a/test/2.off", "a/train/._1.off", ".git/train/x.off", "README.md")
    tree(tmp_path, "__MACOSX/a/train/1.off", "a/train/notes.pdf", "a/.hidden/3.off")
    assert set(listed(open_dataset(str(tmp_path)))) == {"a/1", "a/2"}


def test_files_outside_the_layout_are_counted_in_the_title(tmp_path):
    tree(tmp_path, "a/train/1.off", "a/test/2.off", "b/train/3.off", "extra.off")
    dataset = open_dataset(str(tmp_path))
    assert len(dataset.items) == 3
    assert "1 files outside" in dataset.title


def test_one_more_folder_around_the_set_does_no_harm(tmp_path):
    tree(tmp_path, "MySet/ant/train/1.off", "MySet/ant/test/2.off", "MySet/bee/train/3.off")
    assert open_dataset(str(tmp_path)).classes == ("ant", "bee")


def test_shapes_in_folders_of_their_own_keep_their_folder_in_the_name(tmp_path):
    tree(tmp_path, "ant/x1/model.off", "ant/x2/model.off")
    assert set(listed(open_dataset(str(tmp_path)))) == {"ant/x1/model", "ant/x2/model"}


def test_names_stay_unique_where_only_split_or_suffix_tell_files_apart(tmp_path):
    tree(tmp_path, "a/train/1.off", "a/test/1.off", "a/train/2.off", "a/train/2.obj", "a/train/3.off")
    names = [item.name for item in open_dataset(str(tmp_path)).items]
    assert len(set(names)) == len(names) == 5
    assert "a/3" in names
    assert "a/test/1.off" in names


def test_a_flat_folder_has_no_labels(tmp_path):
    tree(tmp_path, "1.off", "2.OFF", "sub/3.off", "notes.pdf")
    dataset = open_dataset(str(tmp_path))
    assert dataset.classes == ()
    assert listed(dataset) == {"1": ("", "test"), "2": ("", "test"), "sub/3": ("", "test")}
    assert "without labels" in dataset.title


def test_the_up_axis_is_z_only_when_asked_for(tmp_path):
    tree(tmp_path, "ant/train/1.off", "ant/test/2.off")
    assert up_of(open_dataset(f"folder:{tmp_path}")) == "y"
    turned = open_dataset(f"folder:{tmp_path}?up=z")
    assert up_of(turned) == "z"
    assert "z up" in turned.title
    assert turned.items[0].content() != open_dataset(str(tmp_path)).items[0].content()
    assert up_of(open_dataset(turned.spec)) == "z"


def test_one_file_and_a_glob_have_no_labels(tmp_path):
    tree(tmp_path, "a/1.off", "a/2.off", "a/3.txt", "b/1.off")
    assert listed(open_dataset(str(tmp_path / "a" / "1.off"))) == {"1": ("", "test")}
    assert set(listed(open_dataset(f"{tmp_path}/*/?.off"))) == {"a/1", "a/2", "b/1"}
    assert set(listed(open_dataset(f"{tmp_path}/**/2.off"))) == {"2"}


def test_a_folder_with_a_question_mark_or_a_colon_in_its_name_is_a_folder(tmp_path):
    for name in ("what?up=z", "part:one", "[x]"):
        tree(tmp_path / name, "ant/train/1.off", "ant/test/2.off")
        assert up_of(open_dataset(str(tmp_path / name))) == "y"


def test_a_file_name_that_is_not_utf8_is_listed(tmp_path):
    folder = os.fsencode(tree(tmp_path, "ant/train/1.off", "ant/test/2.off") / "ant" / "train")
    with open(folder + b"/\xff\xe9.off", "w") as file:
        file.write(TETRAHEDRON)
    dataset = open_dataset(str(tmp_path))
    assert len(dataset.items) == 3
    assert all(len(item.read().faces) == 4 and item.content() for item in dataset.items)


def test_content_follows_the_bytes_the_suffix_and_nothing_else(tmp_path):
    tree(tmp_path, "a/1.off", "a/2.off")
    (tmp_path / "a" / "3.txt").write_text(TETRAHEDRON)
    one, two, three = (item.content() for item in open_dataset(f"{tmp_path}/a/*").items)
    assert one == two != three
    (tmp_path / "a" / "1.off").write_text(TETRAHEDRON + "\n")
    assert open_dataset(f"{tmp_path}/a/1.off").items[0].content() != one


def test_links_to_class_folders_are_followed_and_loops_end(tmp_path):
    tree(tmp_path / "real", "train/1.off", "test/2.off")
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "ant").symlink_to(tmp_path / "real")
    (tmp_path / "real" / "loop").symlink_to(tmp_path / "set")
    assert {"ant/1", "ant/2"} <= set(listed(open_dataset(str(tmp_path / "set"))))


def message(spec: str) -> str:
    with pytest.raises((DataError, UsageError)) as error:
        open_dataset(spec)
    return f"{error.value.message} | {error.value.hint}"


def test_a_typo_in_a_path_gets_the_nearest_sibling(tmp_path):
    tree(tmp_path, "meshes24/ant/train/1.off")
    assert f"did you mean {tmp_path}/meshes24?" in message(f"folder:{tmp_path}/mehses24")
    assert f"did you mean {tmp_path}/meshes24?" in message(f"{tmp_path}/meshes42/ant/train")


def test_an_unknown_prefix_or_option_gets_the_nearest_one(tmp_path):
    assert "did you mean 'modelnet40'" in message(f"modelnet4:{tmp_path}")
    assert "did you mean 'up'" in message(f"folder:{tmp_path}?ub=z")
    assert "up axis 'x'" in message(f"folder:{tmp_path}?up=x")
    assert "names no data set" in message("folder:")
    assert "empty" in message("")


def test_a_folder_without_a_readable_file_says_what_it_holds(tmp_path):
    assert "the folder is empty" in message(str(tmp_path))
    tree(tmp_path, "ant/train/1.step", "ant/train/2.step", "LIES.md")
    text = message(str(tmp_path))
    assert "0 of 3 files matched" in text
    assert "2 match '*.step'" in text
    assert "*.off" in text


def test_an_empty_split_is_refused_with_what_was_looked_for(tmp_path):
    tree(tmp_path, "ant/train/1.off", "bee/train/1.off", "bee/val/2.off")
    text = message(str(tmp_path))
    assert "split 'test'" in text
    assert f"{tmp_path}/<class>/test/*" in text
    assert "2 in 'train'" in text


def test_a_glob_without_match_says_so(tmp_path):
    tree(tmp_path, "a/1.pdf")
    assert "1 match '*.pdf'" in message(f"{tmp_path}/a/*")
    assert "0 files match" in message(f"{tmp_path}/b/*.off")


def test_real_meshes_are_listed_as_their_index_says(real_data):
    dataset = open_dataset(str(real_data / "meshes24"))
    rows = [line.split("\t") for line in (real_data / "meshes24" / "index.tsv").read_text().splitlines()[1:]]
    expected = {f"{row[0]}/{row[2].removesuffix('.off')}": (row[0], row[1]) for row in rows}
    assert listed(dataset) == expected
    assert len(expected) == 576
    assert len(open_dataset(str(real_data / "modelnet_off")).items) == 23
