"""Opening a data set costs a fixed number of operations a shape: 51,190 shapes must take seconds."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from release_writers import (
    core_v2,
    objects_file,
    off_release,
    put,
    resampled_release,
    shapenet_rows,
    shrec17,
    write_list,
)

from mvtn_cli.core.datasets import open_dataset

DISK = ("scandir", "listdir", "stat", "lstat", "open", "readlink")


def operations(spec: str) -> tuple[int, int]:
    """Return how many functions were called in opening a data set, and how many of them asked the disk."""
    counts: Counter[str] = Counter()

    def count(frame: Any, event: str, function: Any) -> None:
        if event == "c_call":
            counts[function.__name__] += 1
        elif event == "call":
            counts["python"] += 1

    sys.setprofile(count)
    try:
        open_dataset(spec)
    finally:
        sys.setprofile(None)
    return sum(counts.values()), sum(counts[name] for name in DISK)


def v2(root: Path, size: int) -> str:
    rows = shapenet_rows(each=size)
    write_list(root / "all.csv", rows)
    return f"shapenet55:{core_v2(root, rows)}"


def shrec(root: Path, size: int) -> str:
    rows = shapenet_rows(each=size)
    write_list(root / "all.csv", rows)
    return f"shapenet55:{shrec17(root, rows, kinds=('_normal',))}"


def off(root: Path, size: int) -> str:
    return f"modelnet40:{off_release(root, dict.fromkeys(('bed', 'chair', 'sofa'), (size - 1, 1)))}"


def resampled(root: Path, size: int) -> str:
    shapes = [f"{name}_{number:04d}" for name in ("bed", "chair", "sofa") for number in range(size)]
    resampled_release(root, {"train": shapes[1:], "test": shapes[:1]}, ["bed", "chair", "sofa"])
    return f"modelnet40:{root}"


def scans(root: Path, size: int) -> str:
    lines = [f"{number:03d}_00001.bin\t0{'' if number else chr(9) + 't'}" for number in range(3 * size)]
    for line in lines:
        put(root / "bag" / line.split("\t")[0])
    put(root / "main_split.txt", "\n".join(lines))
    return f"scanobjectnn:{root}@with_bg"


def objects(root: Path, size: int) -> str:
    objects_file(root / "main_split" / "training_objectdataset.h5", [4] * (3 * size - 1), points=4)
    objects_file(root / "main_split" / "test_objectdataset.h5", [4], points=4)
    return f"scanobjectnn:{root}@with_bg"


def plain_folder(root: Path, size: int) -> str:
    for name in ("ant", "bee", "cow"):
        for number in range(size):
            put(root / name / f"{number}.off")
    return f"folder:{root}"


@pytest.mark.parametrize("make", [v2, shrec, off, resampled, scans, objects, plain_folder])
def test_operations_grow_in_step_with_the_shapes(tmp_path, make):
    operations(make(tmp_path / "warm", 8))  # what is imported or set up once must not count
    sizes = (8, 16, 32)
    costs, disk = zip(*(operations(make(tmp_path / str(size), size)) for size in sizes), strict=True)
    first, second = costs[1] - costs[0], costs[2] - costs[1]
    assert second <= 2.1 * first
    assert first / (3 * 8) < 120  # calls a shape: 51,190 of them stay within seconds
    asked = 1 if make is v2 else 0  # v2 has a folder for each model, so each is asked for; folders of files are listed
    assert disk[2] - disk[1] == asked * 3 * 16


def test_shapenet_of_true_size_is_listed_without_a_second_look(tmp_path, real_data):
    """All 51,190 rows, with folders that hold nothing: the list is read once, each model asked for once."""
    rows = (real_data / "shapenet" / "all.csv.gz").read_bytes()
    put(tmp_path / "all.csv.gz", rows)
    for split in ("train", "val", "test"):
        put(tmp_path / f"{split}_normal" / "nothing.txt")
    from mvtn_cli.core.datasets import survey

    dataset = survey(f"shapenet55:{tmp_path}")
    assert {part.part: (len(part.names), part.whole) for part in dataset.missing} == {
        "folder train_normal": (35765, True),
        "folder val_normal": (5159, True),
        "folder test_normal": (10266, True),
    }
