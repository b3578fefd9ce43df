"""ModelNet as distributed: OFF folders with z up, and the HDF5 point release with y up."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import h5py
import numpy as np
import pytest

from mvtn_cli.core.datasets import open_dataset
from mvtn_cli.errors import DataError

GLUED_BOX = "OFF4 4 6\r\n0 0 0\r\n1 0 0\r\n0 2 0\r\n0 0 3\r\n3 0 1 2\r\n3 0 1 3\r\n3 0 2 3\r\n3 1 2 3\r\n"


def off_release(root: Path, *classes: str) -> Path:
    for name in classes:
        for split, number in (("train", 1), ("train", 2), ("test", 3)):
            path = root / name / split / f"{name}_{number:04}.off"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(GLUED_BOX)
    return root


def point_release(root: Path, names: list[str], rows: dict[str, list[int]], points: int = 16) -> Path:
    """Write files in the form of the release; the listings carry the folder of the machine that made them."""
    root.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    (root / "shape_names.txt").write_text("\n".join(names) + "\n")
    for split in ("train", "test"):
        stems = [stem for stem in rows if split in stem]
        lines = [f"data/modelnet40_ply_hdf5_2048/{stem}.h5" for stem in stems]
        (root / f"{split}_files.txt").write_text("\n".join(lines) + "\n")
    for stem, labels in rows.items():
        with h5py.File(root / f"{stem}.h5", "w") as file:
            file["data"] = rng.normal(size=(len(labels), points, 3)).astype(np.float32)
            file["label"] = np.array(labels, dtype=np.uint8).reshape(-1, 1)
    return root


def tiny_release(root: Path) -> Path:
    rows = {"ply_data_train0": [2, 0, 1], "ply_data_train1": [0], "ply_data_test0": [1, 2]}
    return point_release(root, ["airplane", "bed", "cone"], rows)


def test_modelnet40_is_turned_from_z_up_to_y_up(tmp_path):
    dataset = open_dataset(f"modelnet40:{off_release(tmp_path, 'night_stand', 'airplane')}")
    assert dataset.classes == ("airplane", "night_stand")
    assert [item.name for item in dataset.items][:3] == [
        "airplane/airplane_0003",
        "airplane/airplane_0001",
        "airplane/airplane_0002",
    ]
    shape = dataset.items[0].read()
    assert np.ptp(shape.vertices, axis=0).tolist() == [1, 3, 2]  # the file's z, 3, is now y
    assert "z up" in dataset.title


def test_a_plain_path_is_modelnet_only_if_every_class_name_is(tmp_path):
    yes = open_dataset(str(off_release(tmp_path / "yes", "chair", "tv_stand")))
    assert "taken for ModelNet by its class names" in yes.title
    assert np.ptp(yes.items[0].read().vertices[:, 1]) == 3
    no = open_dataset(str(off_release(tmp_path / "no", "chair", "dragon")))
    assert np.ptp(no.items[0].read().vertices[:, 1]) == 2
    asked = open_dataset(f"folder:{tmp_path / 'yes'}")
    assert np.ptp(asked.items[0].read().vertices[:, 1]) == 2


def test_modelnet10_takes_its_ten_classes_out_of_forty(tmp_path):
    dataset = open_dataset(f"modelnet10:{off_release(tmp_path, 'chair', 'airplane', 'sofa')}")
    assert dataset.classes == ("chair", "sofa")
    release = tiny_release(tmp_path / "h5")
    assert open_dataset(f"modelnet10:{release}").classes == ("bed",)
    assert [item.label for item in open_dataset(f"modelnet10:{release}").items] == [0, 0]


def test_what_is_not_modelnet_is_refused_with_a_way_out(tmp_path):
    (tmp_path / "chair").mkdir()
    (tmp_path / "chair" / "1.obj").write_text("")
    with pytest.raises(DataError) as error:
        open_dataset(f"modelnet40:{tmp_path}")
    assert "*.off" in error.value.message
    assert "1 match '*.obj'" in error.value.hint
    with pytest.raises(DataError, match="no class folder"):
        open_dataset(f"modelnet40:{off_release(tmp_path / 'own', 'dragon')}")


def test_the_point_release_is_listed_in_the_order_of_its_files(tmp_path):
    root = tiny_release(tmp_path)
    for spec in (str(root), f"modelnet40:{root}"):
        dataset = open_dataset(spec)
        assert dataset.classes == ("airplane", "bed", "cone")
        assert [(item.name, item.label, item.split) for item in dataset.items] == [
            ("cone/train0_0000", 2, "train"),
            ("airplane/train0_0001", 0, "train"),
            ("bed/train0_0002", 1, "train"),
            ("airplane/train1_0000", 0, "train"),
            ("bed/test0_0000", 1, "test"),
            ("cone/test0_0001", 2, "test"),
        ]
        assert "4 train, 2 test" in dataset.title


def test_a_row_gives_its_own_points_and_its_own_content(tmp_path):
    root = tiny_release(tmp_path)
    items = open_dataset(str(root)).items
    with h5py.File(root / "ply_data_train0.h5") as file:
        expected = file["data"][1]
    shape = items[1].read()
    assert shape.points is not None
    assert np.array_equal(shape.points, expected.astype(np.float64))
    assert len(shape.faces) == len(shape.vertices) == 0
    assert len({item.content() for item in items}) == len(items)


def test_a_changed_file_is_not_remembered_within_a_process(tmp_path):
    root = tiny_release(tmp_path)
    before = open_dataset(str(root)).items[0].content()
    with h5py.File(root / "ply_data_train0.h5", "r+") as file:
        file["data"][0] = 7.0
        file["more"] = np.zeros(1000)
    assert open_dataset(str(root)).items[0].content() != before


def test_missing_listings_are_made_up_for(tmp_path):
    root = tiny_release(tmp_path)
    for name in ("train_files.txt", "test_files.txt", "shape_names.txt"):
        (root / name).unlink()
    dataset = open_dataset(str(root))
    assert len(dataset.items) == 6
    assert dataset.classes[:3] == ("airplane", "bathtub", "bed")  # the forty in order


def test_a_damaged_release_is_refused_by_name(tmp_path):
    def refusal(root: Path) -> str:
        with pytest.raises(DataError) as error:
            open_dataset(str(root))
        return error.value.message

    missing = tiny_release(tmp_path / "missing")
    (missing / "ply_data_train1.h5").unlink()
    assert "ply_data_train1.h5, which train_files.txt lists" in refusal(missing)
    cut = tiny_release(tmp_path / "cut")
    (cut / "ply_data_test0.h5").write_bytes((cut / "ply_data_test0.h5").read_bytes()[:900])
    assert "ply_data_test0.h5 is not a file" in refusal(cut)
    with h5py.File(tiny_release(tmp_path / "label") / "ply_data_train0.h5", "r+") as file:
        file["label"][1] = 3
    assert "label 3 is out of range for 3 class names" in refusal(tmp_path / "label")
    with h5py.File(tiny_release(tmp_path / "key") / "ply_data_train0.h5", "r+") as file:
        del file["label"]
    assert "ply_data_train0.h5" in refusal(tmp_path / "key")


def test_the_real_point_release_has_its_official_counts(real_data):
    dataset = open_dataset(str(real_data / "modelnet40_points"))
    rows = [line.split("\t") for line in (real_data / "modelnet40_points" / "counts.tsv").read_text().splitlines()]
    expected = {
        (row[0], split): int(count)
        for row in rows[1:]
        if row[0] in dataset.classes
        for split, count in zip(("train", "test"), row[1:3], strict=True)
    }
    assert (dataset.count("train"), dataset.count("test")) == (9843, 2468)
    assert len(dataset.classes) == 40
    assert Counter((dataset.classes[item.label], item.split) for item in dataset.items) == expected
    ten = open_dataset(f"modelnet10:{real_data / 'modelnet40_points'}")
    assert (ten.count("train"), ten.count("test")) == (3991, 908)
