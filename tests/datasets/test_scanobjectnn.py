"""ScanObjectNN as distributed: HDF5 files of each variant, and the scans with all their points."""

from __future__ import annotations

import pickle
from collections import Counter

import h5py
import numpy as np
import pytest
from release_writers import objects_file, objects_release, put, scan, scans_release

from mvtn_cli.core.datasets import hdf5, open_dataset, survey
from mvtn_cli.core.datasets.official import OFFICIAL
from mvtn_cli.core.datasets.scans import CLASSES
from mvtn_cli.errors import DataError, UsageError

FIFTEEN = (
    *("bag", "bin", "box", "cabinet", "chair", "desk", "display", "door", "shelf"),
    *("table", "bed", "pillow", "sink", "sofa", "toilet"),
)


def refusal(spec: str) -> str:
    with pytest.raises((DataError, UsageError)) as error:
        open_dataset(spec)
    return f"{error.value.message} | {error.value.hint}"


# the HDF5 files


@pytest.mark.parametrize(
    ("variant", "file", "points"),
    [
        ("obj_only", "main_split_nobg/{}_objectdataset.h5", 20),
        ("with_bg", "main_split/{}_objectdataset.h5", 25),
        ("hardest", "main_split/{}_objectdataset_augmentedrot_scale75.h5", 35),
        ("hardest_nobg", "main_split_nobg/{}_objectdataset_augmentedrot_scale75.h5", 30),
        ("OBJ_BG", "main_split/{}_objectdataset.h5", 25),
        ("PB_T50_RS", "main_split/{}_objectdataset_augmentedrot_scale75.h5", 35),
        ("obj-only", "main_split_nobg/{}_objectdataset.h5", 20),
    ],
)
def test_each_variant_has_its_own_files_and_says_which(tmp_path, variant, file, points):
    dataset = open_dataset(f"scanobjectnn:{objects_release(tmp_path)}@{variant}")
    assert dataset.classes == FIFTEEN
    assert [(item.label, item.split) for item in dataset.items] == [
        *((label, "train") for label in (0, 4, 14, 4)),
        *((label, "test") for label in (4, 0)),
    ]
    for item, word, row in ((dataset.items[1], "training", 1), (dataset.items[5], "test", 1)):
        assert item.source == f"{tmp_path / file.format(word)}[{row}]"
        with h5py.File(tmp_path / file.format(word)) as content:
            assert np.array_equal(pickle.loads(pickle.dumps(item)).read().points, content["data"][row])
    assert file.format("{training,test}") in dataset.title and f"{points} points" in dataset.title
    assert open_dataset(dataset.spec).items == dataset.items


def test_without_a_variant_the_objects_alone_are_taken_as_in_the_released_code(tmp_path):
    for spec in (f"scanobjectnn:{objects_release(tmp_path)}", str(tmp_path)):
        assert open_dataset(spec).spec == f"scanobjectnn:{tmp_path}@obj_only"
    assert "taken for scanobjectnn" in open_dataset(str(tmp_path)).title


def test_the_folder_may_be_the_archive_a_split_or_another_split(tmp_path):
    objects_release(tmp_path / "h5_files")
    expected = open_dataset(f"scanobjectnn:{tmp_path / 'h5_files'}@hardest")
    assert open_dataset(f"scanobjectnn:{tmp_path}@hardest").items == expected.items
    assert open_dataset(f"scanobjectnn:{tmp_path / 'h5_files' / 'main_split'}@hardest").items == expected.items
    assert "main_split_nobg" in open_dataset(f"scanobjectnn:{tmp_path / 'h5_files' / 'main_split'}@obj_only").title
    assert expected.release == "scanobjectnn-hardest"
    for folder in ("main_split", "main_split_nobg"):
        (tmp_path / "h5_files" / folder).rename(tmp_path / "h5_files" / folder.replace("main_split", "split2"))
    other = open_dataset(f"scanobjectnn:{tmp_path / 'h5_files' / 'split2'}@obj_only")
    assert "split2_nobg" in other.title and other.release == ""  # no official counts are known for it


def test_a_row_comes_whole_whichever_block_it_lies_in(tmp_path, monkeypatch):
    path = objects_file(tmp_path / "main_split_nobg" / "training_objectdataset.h5", list(range(15)) * 3, points=11)
    objects_file(tmp_path / "main_split_nobg" / "test_objectdataset.h5", [3])
    monkeypatch.setattr(hdf5, "BLOCK_BYTES", 7 * 11 * 3 * 4)
    items = open_dataset(str(tmp_path)).items
    with h5py.File(path) as file:
        data = file["data"][:]
    for row in np.random.default_rng(0).permutation(45):
        assert np.array_equal(items[row].read().points, data[row])


def test_the_mask_is_optional_but_must_fit(tmp_path):
    objects_release(tmp_path)
    path = tmp_path / "main_split" / "training_objectdataset.h5"
    objects_file(path, [1, 2], points=25, mask=False)
    assert len(open_dataset(f"scanobjectnn:{tmp_path}@with_bg").items) == 4
    with h5py.File(path, "r+") as file:
        file["mask"] = np.zeros((2, 24), np.int32)
    assert "data has shape (2, 25, 3) and mask (2, 24)" in refusal(f"scanobjectnn:{tmp_path}@with_bg")


def test_labels_out_of_range_are_refused_and_left_for_the_doctor(tmp_path):
    objects_release(tmp_path)
    objects_file(tmp_path / "main_split_nobg" / "test_objectdataset.h5", [4, 15])
    text = refusal(str(tmp_path))
    assert "test_objectdataset.h5[1]: label 15 is out of range for 15 class names" in text
    assert [item.label for item in survey(str(tmp_path)).items][-2:] == [4, 15]


def test_missing_files_are_named_with_what_is_there(tmp_path):
    objects_release(tmp_path, suffixes=("",))
    text = refusal(f"scanobjectnn:{tmp_path}@hardest")
    assert "main_split/training_objectdataset_augmentedrot_scale75.h5" in text
    assert "there: obj_only, with_bg" in text and "hkust-vgd.github.io/scanobjectnn" in text
    (tmp_path / "main_split" / "test_objectdataset.h5").unlink()
    assert "lacks test_objectdataset.h5" in refusal(f"scanobjectnn:{tmp_path}@with_bg")
    put(tmp_path / "empty" / "notes.txt")
    assert "lacks ScanObjectNN obj_only" in refusal(f"scanobjectnn:{tmp_path / 'empty'}")
    assert "did you mean 'hardest'" in refusal(f"scanobjectnn:{tmp_path}@hardset")


def test_a_cut_file_is_refused_by_name(tmp_path):
    path = objects_release(tmp_path) / "main_split_nobg" / "training_objectdataset.h5"
    path.write_bytes(path.read_bytes()[:700])
    assert f"{path} is not a file of ScanObjectNN" in refusal(str(tmp_path))


# the scans


def test_scans_are_labelled_and_split_by_their_list(tmp_path):
    dataset = open_dataset(f"scanobjectnn:{scans_release(tmp_path)}")
    assert dataset.classes == FIFTEEN
    assert [(item.name, item.label, item.split) for item in dataset.items] == [
        ("bag/005_00020", 0, "train"),
        ("bag/014_00018", 0, "test"),
        ("cabinet/255_00001", 3, "train"),
        ("toilet/700_00012", 14, "test"),
    ]
    assert "main_split.txt" in dataset.title and "2 train, 2 test" in dataset.title
    for path in (tmp_path, tmp_path / "object_dataset"):
        assert open_dataset(str(path)).items == dataset.items


def test_the_background_stays_or_goes_by_the_semantic_label(tmp_path):
    scans_release(tmp_path)
    path = put(tmp_path / "object_dataset" / "bag" / "005_00020.bin", scan(5000, (2, 2, 2, 36, 0, 36, 1, 12)))
    table = np.frombuffer(path.read_bytes()[4:], "<f4").reshape(-1, 11)
    whole = open_dataset(f"scanobjectnn:{tmp_path}@with_bg").items[0]
    alone = open_dataset(f"scanobjectnn:{tmp_path}@obj_only").items[0]
    assert np.array_equal(whole.read().points, table[:, :3]) and len(table) == 5000  # all that the file has
    # Floor (2) is commonest but no object; of the rest, 36 is commoner than 12.
    assert np.array_equal(pickle.loads(pickle.dumps(alone)).read().points, table[table[:, 10] == 36, :3])
    assert whole.content() != alone.content()


def test_hardest_needs_the_hdf5_files_and_those_go_before_scans(tmp_path):
    scans_release(tmp_path)
    text = refusal(f"scanobjectnn:{tmp_path}@hardest")
    assert "lacks ScanObjectNN hardest" in text and "there: obj_only, with_bg" in text
    objects_release(tmp_path / "h5_files")
    assert "(scans, main_split.txt)" in open_dataset(f"scanobjectnn:{tmp_path / 'object_dataset'}").title
    assert "main_split_nobg/" in open_dataset(f"scanobjectnn:{tmp_path}").title


def test_a_missing_list_or_class_is_an_error_with_its_source(tmp_path):
    scans_release(tmp_path)
    listing = tmp_path / "object_dataset" / "main_split.txt"
    text = listing.read_text()
    listing.rename(tmp_path / "split_new.txt")  # as in the archive of the paper's code, one folder higher
    assert len(open_dataset(str(tmp_path)).items) == 4
    (tmp_path / "split_new.txt").unlink()
    assert "lacks main_split.txt" in refusal(str(tmp_path)) and "hkust-vgd/scanobjectnn" in refusal(str(tmp_path))
    listing.write_text(text + "999_00001.bin\t4\n")
    assert "lacks class chair: 1 of the 5 listed shapes" in refusal(str(tmp_path))
    assert len(open_dataset(f"scanobjectnn:{tmp_path}?missing=skip").items) == 4
    listing.write_text(text + "999_00001.bin\t0\n")
    assert "1 listed shapes are not there" in open_dataset(str(tmp_path)).title


@pytest.mark.parametrize("line", ["005_00020.bin", "005_00020.bin\tbag", "005_00020.bin\t15", "005_00020.bin\t0\tx"])
def test_a_damaged_list_is_refused_with_its_line(tmp_path, line):
    listing = scans_release(tmp_path) / "object_dataset" / "main_split.txt"
    listing.write_text(listing.read_text() + "\n" + line + "\n")
    assert "main_split.txt, line 6:" in refusal(str(tmp_path))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (scan(9, (36,))[:-3], "says that it holds 9 points"),
        (scan(9, (36,)) + b"\0" * 44, "says that it holds 9 points"),
        (scan(9, (0, 1, 2)), "has no point of the object"),
        (b"", "is empty (0 bytes)"),
        (b"\0\0", "4 bytes for the number of points"),
    ],
)
def test_a_damaged_scan_is_refused_when_read(tmp_path, content, words):
    put(scans_release(tmp_path) / "object_dataset" / "bag" / "005_00020.bin", content)
    with pytest.raises(DataError) as error:
        open_dataset(str(tmp_path)).items[0].read()
    assert words in error.value.message


def test_official_counts_are_those_of_the_real_list(tmp_path, real_data):
    text = (real_data / "scanobjectnn_splits" / "main_split.txt").read_text()
    for line in text.splitlines():
        put(tmp_path / FIFTEEN[int(line.split("\t")[1])] / line.split("\t")[0], b"")
    put(tmp_path / "main_split.txt", text)
    dataset = open_dataset(f"scanobjectnn:{tmp_path}")
    counts = Counter((dataset.classes[item.label], item.split) for item in dataset.items)
    official = OFFICIAL["scanobjectnn-raw"].classes
    assert counts == {(name, split): count for name in CLASSES for split, count in official[name].items()}
    names = (real_data / "scanobjectnn_splits" / "shape_names_ext.txt").read_text().split()
    assert tuple(names) == FIFTEEN == CLASSES
