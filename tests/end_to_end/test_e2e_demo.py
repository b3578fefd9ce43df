"""`mvtn preprocess && mvtn train && mvtn eval` in a folder that is empty but for tiny settings."""

from __future__ import annotations

import csv
import json
import re

from demonstration import Demo

CLASSES, TEST_SHAPES = 12, 12


def test_every_step_of_the_demo_succeeds_and_names_the_next_one(demo: Demo):
    steps = (demo.preprocess, demo.train, demo.evaluate, demo.again)
    assert [step.code for step in steps] == [0, 0, 0, 0], [step.err for step in steps]
    for step, then in zip(steps, ("mvtn train", "mvtn predict FILES", "mvtn predict FILES", "mvtn train"), strict=True):
        assert step.err.splitlines()[-1].endswith(then)


def test_answers_go_to_stdout_and_everything_else_to_stderr(demo: Demo):
    counts = dict(line.split("\t") for line in demo.preprocess.out.splitlines())
    assert counts == {"kept": "36", "simplified": "0", "mended": "0", "rejected": "0", "reused": "0"}
    header, *rows = (line.split("\t") for line in demo.evaluate.out.splitlines())
    assert header == ["class", "count", "correct", "accuracy %"] and len(rows) == CLASSES + 2
    assert all(len(row) == len(header) for row in rows)
    assert len(re.findall(r"^epoch \d+/8, loss ", demo.train.err, re.M)) == 8
    assert "everyday shapes" in demo.preprocess.err and "(the latest)" in demo.evaluate.err


def test_train_answers_with_run_accuracies_and_seconds(demo: Demo):
    document = demo.train.document
    test = document["test"]
    assert document["seconds"] > 0 and document["warnings"] == [] and test["count"] == TEST_SHAPES
    assert (demo.run / "best.safetensors").stat().st_size > 0
    # a shape a class, so that both are shares of twelve and the same
    assert test["accuracy"] == test["class_accuracy"] == round(test["accuracy"] * TEST_SHAPES) / TEST_SHAPES


def test_eval_finds_what_train_had_measured(demo: Demo):
    accuracy = demo.train.document["test"]["accuracy"]
    rows = {line.split("\t")[0]: line.split("\t") for line in demo.evaluate.out.splitlines()}
    assert rows["all shapes"][3] == rows["mean of classes"][3] == f"{100 * accuracy:.1f}"
    assert json.loads((demo.run / "result.json").read_text())["accuracy"] == accuracy


def test_the_tables_have_a_row_for_each_test_shape_and_view(demo: Demo):
    with (demo.run / "predictions.csv").open(newline="") as file:
        predictions = list(csv.DictReader(file))
    with (demo.run / "views.csv").open(newline="") as file:
        views = list(csv.DictReader(file))
    assert len(predictions) == len({row["name"] for row in predictions}) == TEST_SHAPES
    assert [(row["name"], row["view"]) for row in views] == [
        (row["name"], view) for row in predictions for view in ("0", "1")
    ]
    right = sum(row["label"] == row["predicted"] for row in predictions)
    assert right == sum(int(row["correct"]) for row in predictions)
    assert right / TEST_SHAPES == demo.train.document["test"]["accuracy"]


def test_the_report_is_one_file_that_needs_no_other(demo: Demo):
    report = demo.folder.path / demo.train.document["report"]
    page = report.read_text(encoding="utf-8")
    assert report == demo.run / "report.html"
    assert "<svg" in page and "data:image/png;base64," in page and "learned-spherical" in page
    assert not re.search(r"""(?:src|href)=["'](?!data:|#)""", page)


def test_a_second_preprocess_does_nothing_and_says_so(demo: Demo):
    assert "reused\t36\n" in demo.again.out and "nothing to do: 36 shapes are up to date" in demo.again.err
