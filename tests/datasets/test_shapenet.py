"""ShapeNet Core55 as distributed: SHREC'17's folders and ShapeNetCore.v2, with what is known to be wrong in them."""

from __future__ import annotations

import csv
import gzip
import json
import pickle
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from release_writers import AIRPLANE, CAP, CAR, COLUMNS, core_v2, put, shapenet_rows, shrec17, write_list

from mvtn_cli.core.datasets import open_dataset, survey
from mvtn_cli.core.datasets.official import OFFICIAL
from mvtn_cli.core.datasets.shapenet import CLASSES, SYNSETS
from mvtn_cli.core.shapes import validate
from mvtn_cli.errors import DataError, UsageError

ROWS = shapenet_rows()
NAMES = {AIRPLANE: "airplane", CAP: "cap", CAR: "car"}


def v2_release(root: Path) -> Path:
    write_list(root / "all.csv", ROWS)
    return core_v2(root, ROWS)


def shrec_release(root: Path, **more: object) -> Path:
    write_list(root / "all.csv", ROWS)
    return shrec17(root, ROWS, **more)  # type: ignore[arg-type]


def refusal(spec: str) -> str:
    with pytest.raises((DataError, UsageError)) as error:
        open_dataset(spec)
    return f"{error.value.message} | {error.value.hint}"


def model_folder(root: Path, index: int) -> Path:
    return root / ROWS[index][1] / ROWS[index][3]


@pytest.mark.parametrize("release", [v2_release, shrec_release])
def test_the_list_gives_label_split_and_sub_synset_in_both_trees(tmp_path, release):
    dataset = open_dataset(f"shapenet55:{release(tmp_path)}")
    assert dataset.classes == CLASSES and len(CLASSES) == 55  # whichever synsets are there
    assert {item.name: (CLASSES[item.label], item.split, item.subclass) for item in dataset.items} == {
        f"{NAMES[synset]}/{number}": (NAMES[synset], split, finer) for number, synset, finer, _, split in ROWS
    }
    assert [dataset.count(split) for split in ("train", "val", "test")] == [6, 3, 3]


@pytest.mark.parametrize("release", [v2_release, shrec_release])
def test_each_item_reads_its_own_model_y_up_with_lines_and_missing_materials(tmp_path, release):
    dataset = open_dataset(str(release(tmp_path)))
    for index, item in enumerate(pickle.loads(pickle.dumps(dataset.items))):
        shape = item.read()
        assert np.ptp(shape.vertices, axis=0) == pytest.approx([1 + index / 10, 2, 1])  # nothing was turned
        assert len(shape.faces) == 4
    assert len({item.content() for item in dataset.items}) == len(ROWS)


def test_plain_paths_are_recognised_and_say_so(tmp_path):
    v2_release(tmp_path / "v2")
    shrec_release(tmp_path / "shrec")
    core_v2(tmp_path / "outer" / "ShapeNetCore.v2", ROWS)
    write_list(tmp_path / "outer" / "all.csv", ROWS)
    for path, kind in (("v2", "ShapeNetCore.v2"), ("shrec", "SHREC'17"), ("outer", "ShapeNetCore.v2")):
        dataset = open_dataset(str(tmp_path / path))
        assert kind in dataset.title and "taken for shapenet55" in dataset.title
        assert open_dataset(dataset.spec).items == dataset.items
    beside = open_dataset(f"shapenet55:{tmp_path / 'outer' / 'ShapeNetCore.v2'}")
    assert len(beside.items) == len(ROWS)  # the list lies one folder higher


def test_models_that_v2_lacks_are_counted_and_empty_files_are_met_when_read(tmp_path):
    v2_release(tmp_path)
    shutil.rmtree(model_folder(tmp_path, 8) / "models")  # some car folders lack it
    put(model_folder(tmp_path, 0) / "models" / "model_normalized.obj", "")  # two models are empty files
    dataset = open_dataset(f"shapenet55:{tmp_path}")
    assert "1 listed shapes are not there" in dataset.title
    assert [(part.part, part.names, part.whole) for part in dataset.missing] == [
        ("synset 02958343 (car)", (f"car/{ROWS[8][0]}",), False)
    ]
    with pytest.raises(DataError, match="empty"):
        dataset.items[0].read()


def test_a_missing_synset_is_an_error_that_names_it_and_where_to_get_it(tmp_path):
    shutil.rmtree(v2_release(tmp_path) / CAP)
    text = refusal(f"shapenet55:{tmp_path}")
    assert "lacks synset 02954340 (cap): 4 of the 12 listed shapes" in text
    assert "huggingface.co/datasets/ShapeNet" in text and "--explain-layout" in text
    without = open_dataset(f"shapenet55:{tmp_path}?missing=skip")
    assert len(without.items) == 8 and without.spec.endswith("?missing=skip")
    assert open_dataset(without.spec).items == without.items
    assert survey(f"shapenet55:{tmp_path}").missing[0].whole


def test_a_half_unpacked_set_is_refused(tmp_path):
    v2_release(tmp_path)
    for index in (0, 1, 4, 5):
        shutil.rmtree(model_folder(tmp_path, index))
    assert "4 of the 12 listed shapes, the first is airplane/000003" in refusal(str(tmp_path))


@pytest.mark.parametrize("folder", ["test_normal", "val_normal"])
def test_a_missing_split_folder_is_named(tmp_path, folder):
    shutil.rmtree(shrec_release(tmp_path) / folder)
    assert f"lacks folder {folder}: 3 of the 12 listed shapes" in refusal(f"shapenet55:{tmp_path}")


def test_perturbed_models_are_another_data_set(tmp_path):
    shrec_release(tmp_path)
    normal, named, perturbed = (open_dataset(f"shapenet55:{tmp_path}{tail}") for tail in ("", "@normal", "@perturbed"))
    assert named.items == normal.items
    assert "perturbed" in perturbed.title and perturbed.spec.endswith("@perturbed")
    assert [np.ptp(data.items[0].read().vertices[:, 0]) for data in (normal, perturbed)] == [1, 101]
    assert "did you mean 'perturbed'" in refusal(f"shapenet55:{tmp_path}@pertubed")
    shutil.rmtree(tmp_path / "train_perturbed")
    assert "lacks folder train_perturbed" in refusal(f"shapenet55:{tmp_path}@perturbed")


def test_v2_has_no_perturbed_models(tmp_path):
    assert "unknown variant of ShapeNetCore.v2 'perturbed'" in refusal(f"shapenet55:{v2_release(tmp_path)}@perturbed")


def test_split_folders_may_lack_the_kind_and_files_the_prefix(tmp_path):
    shrec_release(tmp_path, kinds=("",))
    for path in tmp_path.glob("*/model_*.obj"):
        path.rename(path.with_name(path.name.removeprefix("model_")))
    assert len(open_dataset(str(tmp_path)).items) == len(ROWS)
    assert "lacks folder train_perturbed" in refusal(f"shapenet55:{tmp_path}@perturbed")  # not the plain ones instead


def test_other_folders_called_train_and_test_are_not_taken_for_it(tmp_path):
    for name in ("train/cat/a.obj", "test/cat/b.obj"):
        put(tmp_path / name)
    put(tmp_path / "train.csv", "file,label\na.obj,cat\n")
    assert "SPLIT/CLASS/file" in open_dataset(str(tmp_path)).title


def test_without_the_list_it_says_which_and_where(tmp_path):
    (v2_release(tmp_path) / "all.csv").unlink()
    text = refusal(str(tmp_path))
    assert "lacks SHREC'17's list all.csv" in text
    assert "shapenet.cs.stanford.edu/shrec17" in text and f"folder:{tmp_path}" in text
    assert len(open_dataset(f"folder:{tmp_path}").items) == len(ROWS)
    assert "lacks SHREC'17's list" in refusal(f"shapenet55:{tmp_path / AIRPLANE}")


def test_lists_before_the_test_labels_were_published_give_no_test_shapes(tmp_path):
    shrec_release(tmp_path)
    (tmp_path / "all.csv").unlink()
    for split in ("train", "val"):
        write_list(tmp_path / f"{split}.csv", [row for row in ROWS if row[4] == split])
    assert "no shapes for split 'test'" in refusal(str(tmp_path))
    write_list(tmp_path / "test.csv", [row for row in ROWS if row[4] == "test"])
    assert len(open_dataset(str(tmp_path)).items) == len(ROWS)


def test_the_list_may_be_packed_renamed_or_saved_by_a_spreadsheet(tmp_path):
    expected = open_dataset(str(v2_release(tmp_path))).items
    text = (tmp_path / "all.csv").read_text()
    (tmp_path / "all.csv").unlink()
    put(tmp_path / "shapenet_split.csv.gz", gzip.compress(text.encode()))
    assert open_dataset(str(tmp_path)).items == expected
    (tmp_path / "shapenet_split.csv.gz").unlink()
    lines = ["split,modelId,id,synsetId,subSynsetId"]
    lines += [
        f"{split},{model},{int(number)},{int(synset)},{int(finer)}" for number, synset, finer, model, split in ROWS
    ]
    put(tmp_path / "shapenet_split.csv", "\ufeff" + "\r\n".join(lines) + "\r\n")
    assert open_dataset(str(tmp_path)).items == expected


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("000003,02999999,02999999,abc,train", "line 14: synset '02999999' is none of the 55"),
        ("000099,02691156,02690373,abc,dev", "line 14: split 'dev'"),
        ("000003,02691156,02690373,abc,train", "line 14: id 000003 is there twice"),
        ("000099,02691156", "line 14 has 2 cells"),
    ],
)
def test_a_damaged_list_is_refused_with_its_line(tmp_path, line, words):
    path = v2_release(tmp_path) / "all.csv"
    path.write_text(path.read_text() + line + "\n")
    assert words in refusal(str(tmp_path))


@pytest.mark.parametrize(
    "damage",
    [b"a,b,c\n1,2,3\n", b"", b"\xff\xfe\x00", gzip.compress(b"x" * 999, mtime=0)[:20]],
    ids=["other-columns", "empty", "no-text", "cut-gzip"],
)
def test_what_is_no_list_is_refused(tmp_path, damage):
    v2_release(tmp_path)
    (tmp_path / "all.csv").unlink()
    put(tmp_path / ("all.csv.gz" if damage.startswith(b"\x1f\x8b") else "all.csv"), damage)
    text = refusal(f"shapenet55:{tmp_path}")
    assert "is not SHREC'17's list" in text and COLUMNS in text


def test_the_fixed_classes_and_official_counts_are_those_of_the_real_list(real_data):
    names = json.loads((real_data / "shapenet" / "synset_names.json").read_text())
    assert list(SYNSETS) == sorted(names)
    assert [names[synset].replace(" ", "_") for synset in SYNSETS] == list(CLASSES)
    with gzip.open(real_data / "shapenet" / "all.csv.gz", "rt") as file:
        counts = Counter((row["synsetId"], row["split"]) for row in csv.DictReader(file))
    official = OFFICIAL["shapenet55"].classes
    assert counts == {
        (synset, split): count
        for synset, name in zip(SYNSETS, CLASSES, strict=True)
        for split, count in official[name].items()
    }


def test_real_models_of_v2_are_read_through_the_tree(tmp_path, real_data):
    models = sorted((real_data / "shapenet" / "models").rglob("*.obj"))
    rows = shapenet_rows(each=len(models))[: len(models)]
    write_list(tmp_path / "all.csv", rows)
    for row, model in zip(rows, models, strict=True):
        put(tmp_path / row[1] / row[3] / "models" / "model_normalized.obj", model.read_bytes())
    items = open_dataset(str(tmp_path)).items
    assert len(items) == len(models) == 6
    for item in items:
        shape, findings = validate(item.read())
        assert not any(finding.fatal for finding in findings) and len(shape.faces) > 100
