from __future__ import annotations

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mvtn_cli.config import EvalConfig, TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.evaluation.evaluate import evaluate_run, judge, mistakes, results_folder, write_tables
from mvtn_cli.core.evaluation.files import read_csv
from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.preprocess import Settings
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.training.checkpoint import write_weights
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import DataError, UsageError

CLASSES = ("chair, high", 'so"fa', "table")


def found(known: bool = False) -> SimpleNamespace:
    logits = np.array([[5.0, 0, 0], [0, 1, 0], [0, 0, 2], [3, 0, 0], [np.nan, 0, 0]], np.float32)
    return SimpleNamespace(
        names=("a,b", "b", "c", "d", "e"),
        labels=np.array([0, 0, 2, 1, 1]),
        logits=logits,
        azimuth_deg=np.array([[10.0, 370.0]] * 5, np.float32),
        elevation_deg=np.zeros((5, 2), np.float32),
        distance=np.full((5, 2), 2.2, np.float32),
        known_azimuth_deg=np.array([0.0, np.nan, 30.0, 10.0, 10.0]) if known else np.full(5, np.nan),
    )


def test_the_known_view_is_judged_only_where_it_is_known():
    assert judge(found(), CLASSES)["known_view"] is None
    known = judge(found(known=True), CLASSES)["known_view"]
    assert known["count"] == 4 and known["median_deg"] == pytest.approx(5.0)


def test_mistakes_come_surest_first_and_leave_out_shapes_without_an_answer():
    listed = mistakes(found(), CLASSES, list("vwxyz"))
    assert [m["name"] for m in listed] == ["d", "b"]
    surest = listed[0]
    assert (surest["label"], surest["predicted"], surest["source"]) == ('so"fa', "chair, high", "y")
    assert surest["probability"] == pytest.approx(np.exp(3) / (np.exp(3) + 2))
    assert surest["probability"] + 2 * surest["label_probability"] == pytest.approx(1)


def test_a_network_of_points_has_no_views_to_judge_or_to_write(tmp_path):
    judged = judge(found(known=True), CLASSES, uses_views=False)
    assert judged["views"] is None and judged["known_view"] is None and judged["count"] == 5
    (tmp_path / "views.csv").write_text("of an earlier run")
    write_tables(tmp_path, found(), CLASSES, ["s1", "s2", "s3", "s4", "s5"], uses_views=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["confusion.csv", "predictions.csv"]


def test_tables_survive_names_with_commas_and_have_the_promised_columns(tmp_path):
    write_tables(tmp_path, found(known=True), CLASSES, ["s,1", "s2", "s3", "s4", "s5"])
    rows = read_csv(tmp_path / "predictions.csv")
    assert list(rows[0]) == ["name", "label", "predicted", "probability", "correct", "source"]
    assert (rows[0]["name"], rows[0]["label"], rows[0]["source"]) == ("a,b", "chair, high", "s,1")
    assert [row["correct"] for row in rows[:4]] == ["1", "0", "1", "0"]
    views = read_csv(tmp_path / "views.csv")
    assert list(views[0])[2:] == ["view", "azimuth_deg", "elevation_deg", "distance", "known_azimuth_deg"]
    assert len(views) == 10 and [views[1]["view"], views[1]["azimuth_deg"]] == ["1", "370"]
    assert views[2]["known_azimuth_deg"] == "" and views[4]["known_azimuth_deg"] == "30"
    with (tmp_path / "confusion.csv").open(newline="") as stream:
        table = list(csv.reader(stream))
    assert table[0] == ["label", *CLASSES] and table[1] == ["chair, high", "1", "1", "0"]


def test_only_the_usual_evaluation_goes_into_the_run_itself():
    run = Path("runs/a")
    assert results_folder(run, "test", "best") == run
    assert results_folder(run, "val", "best") == run / "val-best"
    assert results_folder(run, "test", "last") == run / "test-last"
    assert results_folder(run, "val", "best", Path("x")) == Path("x")


def shape(label: int, index: int) -> StoredShape:
    """A double pyramid, flat (0) or tall (1)."""
    stretch = np.array([1.0, 0.3, 1.0] if label == 0 else [0.3, 1.0, 0.3]) * (1 - 0.01 * index)
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]) * stretch
    faces = np.array([[a, b, c] for a in (0, 1) for b in (2, 3) for c in (4, 5)], np.int32)
    points = np.random.default_rng(index).dirichlet((1, 1, 1), 64)[:, :, None] * corners[[0, 2, 4]]
    vertices = corners.astype(np.float32)
    return StoredShape(
        vertices, faces, vertices / np.linalg.norm(vertices, axis=1, keepdims=True), None,
        points.sum(axis=1).astype(np.float32), None, np.zeros(3), 1.0,
    )  # fmt: skip


def toy(classes: tuple[str, ...] = ("flat", "tall")) -> SimpleNamespace:
    records = [
        SimpleNamespace(
            name=f"{split}/{i}",
            label=i % 2,
            split=split,
            source=f"{split}-{i}.off",
            known_azimuth_deg=float("nan"),
        )
        for split in ("train", "test")
        for i in range(8)
    ]
    return SimpleNamespace(
        spec="toy", title="two kinds of pyramids", classes=classes, known_view=False, address="abc",
        settings=Settings(max_vertices=100, num_points=32, seed=0),
        records=records,
        load=lambda i: shape(records[i].label, i),
        split=lambda name: [i for i, record in enumerate(records) if record.split == name],
    )  # fmt: skip


@pytest.fixture
def run(tmp_path) -> Run:
    """A run that was never trained: its random weights make mistakes enough."""
    config = TrainConfig(dataset="toy", num_views=2, image_size=16, views="learned-spherical", seed=1)
    made = Run.create(tmp_path / "runs" / "a", config, toy())
    write_weights(made.weights_path("best"), build_recogniser(config, 2).state_dict(), {"epoch": 1})
    return made


def test_a_run_is_judged_and_the_files_say_the_same(run):
    result = evaluate_run(run, toy(), EvalConfig(device="cpu", batch_size=3), Console(quiet=True))
    written = json.loads((run.path / "result.json").read_text())
    assert written["schema"] == "mvtn.eval/1" and written["count"] == 8
    assert written["accuracy"] == result["accuracy"] and written["data"]["address"] == "abc"
    assert written["views"]["moved_deg"] == pytest.approx(0, abs=1e-4), "untrained offsets are zero"
    rows = read_csv(run.path / "predictions.csv")
    assert np.mean([row["correct"] == "1" for row in rows]) == result["accuracy"]
    assert [row["source"] for row in rows] == [f"test-{i}.off" for i in range(8)]
    with np.load(run.path / "mistakes.npz") as kept:
        wrong = [m["name"] for m in result["mistakes"]]
        assert kept["names"].tolist() == wrong and kept["images"].shape == (len(wrong), 2, 3, 16, 16)
        assert kept["images"].reshape(len(wrong), -1).std(axis=1).min() > 5


def test_an_evaluation_does_not_depend_on_the_batch_and_val_goes_beside(run):
    tables = []
    for size in (1, 8):
        config = EvalConfig(device="cpu", batch_size=size, split="val")
        result = evaluate_run(run, toy(), config, Console(quiet=True))
        tables.append(read_csv(run.path / "val-best" / "views.csv"))
        tables[-1] += read_csv(run.path / "val-best" / "predictions.csv")
    assert result["folder"] == str(run.path / "val-best") and not (run.path / "result.json").exists()
    assert result["count"] == 2, "one of each class is held out of train"
    assert tables[0] == tables[1]


def test_other_classes_and_empty_splits_are_refused(run):
    with pytest.raises(UsageError, match=r"knows the classes flat, tall \(2\), and toy has x, y \(2\)") as refused:
        evaluate_run(run, toy(("x", "y")), EvalConfig(device="cpu"), Console(quiet=True))
    assert refused.value.hint == "train on it: mvtn train toy; or ask for the classes of single files: mvtn predict"
    empty = toy()
    empty.split = lambda name: []
    with pytest.raises(DataError, match="no labelled shapes for split 'test' in toy"):
        evaluate_run(run, empty, EvalConfig(device="cpu"), Console(quiet=True))
