"""Each command: what it asks of core, what it answers, how it ends. Core is real where that is quick."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from running import Outcome

from mvtn_cli.commands import doctor as doctor_command
from mvtn_cli.commands import eval as eval_command
from mvtn_cli.commands import predict as predict_command
from mvtn_cli.commands import render_views as render_views_command
from mvtn_cli.commands import train as train_command
from mvtn_cli.commands.doctor import Finding
from mvtn_cli.commands.sources import expand, names_given, up_axis
from mvtn_cli.errors import DataError, UsageError

Mvtn = Callable[..., Outcome]
FakeModule = Callable[..., None]

TETRAHEDRON = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


@pytest.fixture
def fake_module(monkeypatch: pytest.MonkeyPatch) -> FakeModule:
    """Put a module in the place of one that would import torch."""

    def replace(name: str, **contents: Any) -> None:
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)

    return replace


def write_shapes(folder: Path, *names: str) -> list[Path]:
    paths = [folder / name for name in names]
    for number, path in enumerate(paths):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(TETRAHEDRON.replace("0 0 1\n", f"0 0 {1 + number}\n", 1))
    return paths


@pytest.fixture
def shapes(own_folder: Path) -> Path:
    """Two classes of two shapes each, one of them broken."""
    root = own_folder / "set"
    names = [f"{kind}/{split}/{kind}_{split}.off" for kind in ("chair", "table") for split in ("train", "test")]
    write_shapes(root, *names)
    (root / "chair/train/broken.off").write_text("OFF\n3 1 0\n0 0 0\n")
    return root


# preprocess


def test_preprocess_counts_names_the_bad_file_and_exits_with_1(shapes: Path, mvtn: Mvtn):
    result = mvtn("preprocess", shapes, "-j", 1, "--json")
    document = result.document
    assert result.code == 1 and result.error["code"] == "dataset.bad-files"
    assert [document[key] for key in ("kept", "rejected", "reused", "simplified")] == [4, 1, 0, 0]
    assert set(document) >= {"mended", "findings", "seconds", "schema", "warnings"}
    fatal = [finding for finding in document["findings"] if finding["fatal"]]
    assert [Path(finding["file"]).name for finding in fatal] == ["broken.off"]
    assert f"bad: {fatal[0]['file']}: {fatal[0]['finding']}" in result.err


def test_preprocess_can_skip_bad_files_and_a_second_run_does_nothing(shapes: Path, mvtn: Mvtn):
    first = mvtn("preprocess", shapes, "-j", 1, "--on-bad", "skip")
    assert first.code == 0 and "warning: 1 of 5 shapes can't be used" in first.err
    assert "kept\t4\n" in first.out and "rejected\t1\n" in first.out
    assert first.err.splitlines()[-1].endswith("next: mvtn train")
    second = mvtn("preprocess", "-j", 1, "--on-bad", "skip", "--json")  # bare: the same set, which is said
    assert second.document["reused"] == second.document["kept"] == 4
    assert str(shapes) in second.err


def test_preprocess_dry_run_tells_the_plan_and_writes_nothing(shapes: Path, own_cache: Path, mvtn: Mvtn):
    plan = mvtn("preprocess", shapes, "--dry-run", "--json").document
    assert (plan["dry_run"], plan["shapes"], plan["classes"], plan["stored"], plan["to_do"]) == (
        True,
        5,
        2,
        0,
        5,
    )
    assert not own_cache.exists()
    mvtn("preprocess", shapes, "-j", 1)
    assert mvtn("preprocess", shapes, "-n", "--json").document["stored"] == 4


def test_preprocess_of_nothing_usable_fails_even_when_bad_files_are_skipped(own_folder: Path, mvtn: Mvtn):
    (own_folder / "empty.off").write_text("")
    result = mvtn("preprocess", "empty.off", "--on-bad", "skip")
    assert result.code == 1 and "error: 1 of 1 shapes can't be used" in result.err


def test_preprocess_of_a_missing_folder_fails_in_one_sentence(mvtn: Mvtn):
    result = mvtn("preprocess", "nowhere")
    assert result.code == 1 and result.err.startswith("error: ") and "nowhere" in result.err
    assert "Traceback" not in result.err


# train and eval

RESULT = {
    "schema": "mvtn.eval/1",
    "split": "test",
    "count": 4,
    "correct": 3,
    "accuracy": 0.75,
    "class_accuracy": 0.5,
    "per_class": [
        {"name": "chair", "count": 3, "correct": 3, "accuracy": 1.0},
        {"name": "table", "count": 1, "correct": 0, "accuracy": 0.0},
    ],
    "known_view": {"median_deg": 14.2, "within_30": 0.8, "over_90": 0.05},
    "baseline": {"accuracy": 0.5},
    "view_analysis": None,
}


@pytest.fixture
def fake_core(own_folder: Path, fake_module: FakeModule, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A core that trains and measures in no time and remembers what it was asked."""
    seen = SimpleNamespace(prepared=SimpleNamespace(spec="set", address="a1"), threads=[], result=RESULT)
    seen.run = SimpleNamespace(path=Path("runs/r"), info={"dataset": "set", "data_address": "a1", "title": "y up"})

    def train(config: Any, prepared: Any, console: Any) -> Any:
        seen.train = (config, prepared)
        return seen.run

    def compare(config: Any, selections: Any, seeds: int, prepared: Any, console: Any) -> Any:
        seen.compare = (config, selections, seeds)
        return {
            "path": "runs/compare",
            "selections": [{"selection": name, "mean": 0.5, "sd": 0.01} for name in selections],
            "differences": [{"a": "fixed", "b": "random", "mean": -0.1, "low": -0.2, "high": 0.0}],
        }

    def evaluate_run(run: Any, prepared: Any, config: Any, console: Any) -> Any:
        seen.evaluate = (run, prepared, config)
        if isinstance(seen.result, Exception):
            raise seen.result
        return {**seen.result, "folder": str(run.path)}

    monkeypatch.setattr(train_command, "open_shapes", lambda spec, config, call: seen.prepared)
    monkeypatch.setattr(eval_command, "open_shapes_of", lambda run, config, call: seen.prepared)
    monkeypatch.setattr(eval_command, "find_run", lambda name, runs, call: seen.run)
    fake_module("mvtn_cli.core.training.loop", train=train)
    fake_module("mvtn_cli.core.training.compare", compare=compare)
    fake_module("mvtn_cli.core.training.device", use_threads=seen.threads.append)
    fake_module("mvtn_cli.core.evaluation.evaluate", evaluate_run=evaluate_run)
    fake_module("mvtn_cli.core.reporting", write_report=lambda run, folder: folder / "report.html")
    fake_module("mvtn_cli.core.reporting.report", write_report=lambda run, folder: folder / "report.html")
    return seen


def test_train_trains_measures_and_answers(fake_core: SimpleNamespace, mvtn: Mvtn):
    result = mvtn("train", "builtin:shapes", "--views", "learned", "--epochs", 2, "--threads", 1, "--json")
    document = result.document
    assert result.code == 0
    assert document["run"] == "runs/r" and document["report"] == "runs/r/report.html"
    assert document["test"] == {"count": 4, "accuracy": 0.75, "class_accuracy": 0.5}
    assert document["seconds"] >= 0 and document["known_view"]["median_deg"] == 14.2
    config, prepared = fake_core.train
    assert (config.views, config.epochs, config.dataset) == ("learned-spherical", 2, "builtin:shapes")
    assert type(config).__name__ == "TrainConfig" and prepared is fake_core.prepared
    assert fake_core.evaluate[2].split == "test" and fake_core.threads == [1]
    last = result.err.splitlines()[-1]
    assert last.startswith("trained runs/r in ") and "next: " in last


def test_train_answers_people_with_a_record_a_line(fake_core: SimpleNamespace, mvtn: Mvtn):
    assert mvtn("train").out.splitlines() == [
        *("run\truns/r", "accuracy\t0.7500", "class_accuracy\t0.5000", "report\truns/r/report.html")
    ]


def test_train_without_test_shapes_is_a_success_with_a_warning(fake_core: SimpleNamespace, mvtn: Mvtn):
    fake_core.result = DataError("no labelled shapes for split 'test'", code="dataset.empty-split")
    result = mvtn("train", "--json")
    assert result.code == 0 and result.document["test"] is None
    assert result.document["warnings"] == ["not measured: no labelled shapes for split 'test'"]
    fake_core.result = DataError("damaged")
    assert mvtn("train").code == 1


def test_train_compare_prints_one_table_of_means_and_one_of_differences(fake_core: SimpleNamespace, mvtn: Mvtn):
    result = mvtn("train", "--compare", "fixed,random", "--seeds", 4)
    config, selections, seeds = fake_core.compare
    assert (selections, seeds, config.views) == (["fixed", "random"], 4, "fixed")
    assert result.out.splitlines() == [
        "views\tmean\tsd",
        "fixed\t50.0\t1.0",
        "random\t50.0\t1.0",
        "difference\tmean\tlow\thigh",
        "random - fixed\t-10.0\t-20.0\t+0.0",
    ]
    assert mvtn("train", "--compare", "fixed,random", "--json").document["schema"] == "mvtn.compare/1"


def test_train_dry_run_tells_the_plan_and_writes_nothing(own_folder: Path, own_cache: Path, mvtn: Mvtn):
    words = ("train", "builtin:shapes?train=48&test=24", "--epochs", 3, "--batch-size", 10, "--json", "-n")
    plan = mvtn(*words).document
    assert (plan["train"], plan["val"], plan["test"], plan["steps"], plan["trainings"]) == (43, 5, 24, 15, 1)
    assert mvtn(*words, "--compare", "fixed,learned", "--seeds", 2).document["trainings"] == 4
    plan = mvtn(*words, "--batch-size", "auto").document
    assert (plan["batch_size"], plan["steps"]) == (32, 6)
    assert not own_cache.exists() and not list(own_folder.iterdir())


def test_eval_prints_every_class_and_what_a_number_cannot_say(fake_core: SimpleNamespace, mvtn: Mvtn):
    result = mvtn("eval", "--baseline", "--split", "val")
    assert result.code == 0
    assert result.out.splitlines() == [
        "class\tcount\tcorrect\taccuracy %",
        "chair\t3\t3\t100.0",
        "table\t1\t0\t0.0",
        "all shapes\t4\t3\t75.0",
        "mean of classes\t\t\t50.0",
        "known view: median error 14.2°, 80.0 % within 30°, 5.0 % over 90°",
        "baseline: histogram forest 50.0 %, +25.0 points to this run",
    ]
    config = fake_core.evaluate[2]
    assert (config.baseline, config.split) == (True, "val")
    assert mvtn("eval", "--json").document["report"] == "runs/r/report.html"


def test_eval_warns_when_the_data_have_changed_since_the_training(fake_core: SimpleNamespace, mvtn: Mvtn):
    fake_core.prepared.address = "b2"
    result = mvtn("eval", "--json")
    assert result.code == 0 and "is not what runs/r was trained on" in result.document["warnings"][0]


@pytest.mark.parametrize("words", [["eval"], ["predict", "a.off"], ["render-views", "--views", "learned"]])
def test_without_any_run_the_hint_is_to_train_one(words: list[str], mvtn: Mvtn):
    result = mvtn(*words)
    assert result.code == 1 and "mvtn train" in result.err


# predict


@pytest.fixture
def fake_model(fake_module: FakeModule, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A model that takes the first shape of a batch for a chair and all others for tables."""
    seen = SimpleNamespace(batches=[])
    run = SimpleNamespace(
        path=Path("runs/r"),
        classes=("chair", "table", "mug"),
        config=SimpleNamespace(batch_size=2),
        info={"title": "set, z up: 4", "preprocess": {"max_vertices": 100, "num_points": 32, "seed": 0}},
    )

    def classify(model: Any, prepared: Any, indices: Any, config: Any, *, batch_size: int) -> Any:
        seen.batches.append(len(indices))
        seen.prepared = prepared
        logits = [[2.0, 1.0, -9.0] if index == 0 else [1.0, 3.0, -9.0] for index in indices]
        return SimpleNamespace(logits=np.array(logits, np.float32))

    monkeypatch.setattr(predict_command, "find_run", lambda name, runs, call: run)
    fake_module("mvtn_cli.core.training.predict", load_model=lambda *words: None, predict=classify)
    fake_module("mvtn_cli.core.training.device", use_threads=lambda threads: None)
    return seen


def test_predict_answers_with_class_and_probability_in_the_order_given(
    own_folder: Path, fake_model: SimpleNamespace, mvtn: Mvtn
):
    write_shapes(own_folder, "b.off", "a.off")
    result = mvtn("predict", "b.off", "a.off", "-j", 1)
    assert result.code == 0
    assert result.out == "b.off\tchair\t0.73\na.off\ttable\t0.88\n"
    assert result.err.splitlines()[-1].startswith("2 files classified by runs/r in ")
    assert fake_model.prepared.items[0].read.up == "z"  # as in the run's data set
    assert fake_model.prepared.settings.num_points == 32  # prepared as the run's shapes were
    assert mvtn("predict", "b.off", "--top", 2).out == "b.off\tchair\t0.73\ttable\t0.27\n"


def test_predict_answers_all_others_when_a_file_is_bad(own_folder: Path, fake_model: SimpleNamespace, mvtn: Mvtn):
    write_shapes(own_folder, "a.off")
    (own_folder / "bad.off").write_text("nonsense")
    result = mvtn("predict", "bad.off", "a.off", "missing.off", "-j", 1, "--json")
    assert result.code == 1 and result.error["code"] == "files.bad"
    assert [answer["file"] for answer in result.document["predictions"]] == ["a.off"]
    assert result.document["bad"] == 2
    assert "warning: missing.off: no such file" in result.err and "warning: bad.off: " in result.err
    assert mvtn("predict", "bad.off", "a.off", "-j", 1, "--on-bad", "skip").code == 0
    assert mvtn("predict", "bad.off", "-j", 1, "--json").document["predictions"] == []


def test_predict_streams_batches_of_names_from_standard_input(
    own_folder: Path, fake_model: SimpleNamespace, mvtn: Mvtn
):
    names = ["with space.off", "line\nbreak.off", " lead.off", "ä.off", "sub/e.off"]
    write_shapes(own_folder, *names)
    result = mvtn("predict", "-", "--jsonl", "--batch-size", 2, "-j", 1, stdin="\0".join(names) + "\0")
    assert result.code == 0
    assert [json.loads(line)["file"] for line in result.out.splitlines()] == names
    assert fake_model.batches == [2, 2, 1]
    assert mvtn("predict", *names, "-j", 1, "--batch-size", "auto").code == 0
    assert fake_model.batches[3:] == [2, 2, 1]  # as in training
    lines = mvtn("predict", "-", "-j", 1, stdin="with space.off\r\nsub/e.off\n\n")
    assert [line.split("\t")[0] for line in lines.out.splitlines()] == ["with space.off", "sub/e.off"]


@pytest.mark.parametrize("words", [("predict", "-"), ("render-views", "-"), ("predict",)])
def test_no_names_is_wrong_use(words: tuple[str, ...], mvtn: Mvtn):
    result = mvtn(*words, stdin="\n  \n")
    assert result.code == 2 and result.out == "" and len(result.err.splitlines()) == 2


def test_a_terminal_as_standard_input_is_not_waited_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True))
    with pytest.raises(UsageError, match="standard input names no files"):
        names_given(["a", "-"])


def test_folders_and_patterns_become_their_shape_files_once(own_folder: Path):
    write_shapes(own_folder, "d/b.off", "d/deep/a.OFF", "d/c[1].off")
    (own_folder / "d/readme.txt.md").write_text("")
    assert list(expand(["d"])) == ["d/b.off", "d/c[1].off", "d/deep/a.OFF"]
    assert list(expand(["d/*.off", "d/b.off", "./d/b.off"])) == ["d/b.off", "d/c[1].off"]
    assert list(expand(["d/c[1].off", "gone.off"])) == ["d/c[1].off", "gone.off"]
    with pytest.raises(DataError, match=r"x\*\.off matches no shape file"):
        list(expand(["x*.off"]))


def test_the_up_axis_is_as_asked_else_as_in_the_run():
    run: Any = SimpleNamespace(info={"title": "ModelNet (OFF), z up: 2 shapes in 1 classes"})
    assert (up_axis("y", run), up_axis(None, run), up_axis(None, None)) == ("y", "z", "y")


# render-views


@pytest.fixture
def fake_drawing(fake_module: FakeModule, monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, Any]]:
    """A core that draws nothing and remembers what it was asked."""
    asked: list[tuple[Any, Any]] = []

    def render_views(parts: Any, config: Any, console: Any, *, total: int | None = None) -> Iterator[dict[str, Any]]:
        for prepared in parts:
            asked.append((prepared, config))
            for record in prepared.records:
                yield {"file": record.source, "picture": f"{config.out}/{record.name}.png"}

    fake_module("mvtn_cli.core.reporting", render_views=render_views)
    record = SimpleNamespace(source="set/a", name="a")
    prepared = SimpleNamespace(records=[record], spec="set")
    monkeypatch.setattr(
        render_views_command,
        "open_shapes",
        lambda spec, config, call: SimpleNamespace(**{**vars(prepared), "spec": spec}),
    )
    run = SimpleNamespace(path=Path("runs/r"), info={"dataset": "of-the-run", "title": ""})
    monkeypatch.setattr(
        render_views_command,
        "open_shapes_of",
        lambda run, config, call: SimpleNamespace(**{**vars(prepared), "spec": run.info["dataset"]}),
    )
    monkeypatch.setattr(render_views_command, "find_run", lambda name, runs, call: run)
    return asked


def test_render_views_draws_files_and_names_the_picture_of_each(
    own_folder: Path, fake_drawing: list[tuple[Any, Any]], mvtn: Mvtn
):
    write_shapes(own_folder, "a.off")
    result = mvtn("render-views", "a.off", "gone.off", "-o", "out", "-j", 1, "--azimuth", "0,90", "--elevation", "30")
    assert result.code == 1
    assert result.out == f"{own_folder}/a.off\tout/a.png\n"
    _, config = fake_drawing[0]
    assert (config.azimuth, config.elevation, config.run) == ((0.0, 90.0), (30.0,), None)
    assert mvtn("render-views", "gone.off", "--json", "--on-bad", "skip").document["bad"] == 1


@pytest.mark.parametrize(
    ("words", "spec", "run"),
    [
        (["builtin:shapes"], "builtin:shapes", None),
        ([], None, None),
        (["--views", "learned"], "of-the-run", "runs/r"),
        (["--views", "transferred"], "of-the-run", "runs/r"),
        (["runs/r"], "of-the-run", "runs/r"),
        (["r"], "of-the-run", "runs/r"),
        (["set", "--run", "r"], "set", "runs/r"),
    ],
)
def test_render_views_tells_runs_from_data_sets(
    words: list[str],
    spec: str | None,
    run: str | None,
    fake_drawing: list[tuple[Any, Any]],
    mvtn: Mvtn,
    own_folder: Path,
):
    (own_folder / "runs/r").mkdir(parents=True)
    (own_folder / "runs/r/run.json").write_text("{}")
    (own_folder / "set").mkdir()
    result = mvtn("render-views", *words, "--json")
    assert result.code == 0 and len(result.document["pictures"]) == 1
    prepared, config = fake_drawing[0]
    assert (prepared.spec, config.run) == (spec, run)


# cache and doctor


def test_cache_shows_what_is_stored_and_clears_only_when_sure(shapes: Path, own_cache: Path, mvtn: Mvtn):
    mvtn("preprocess", shapes, "-j", 1)
    shown = mvtn("cache", "--json").document
    assert shown["root"] == str(own_cache) and shown["kinds"]["shapes"]["files"] == 4
    assert shown["bytes"] == sum(kind["bytes"] for kind in shown["kinds"].values()) > 0
    unsure = mvtn("cache", "clear")
    assert unsure.code == 2 and "add --yes" in unsure.err
    assert mvtn("cache", "--json").document == shown
    cleared = mvtn("cache", "clear", "--kind", "shapes", "--yes", "--json").document
    assert (cleared["action"], cleared["files"]) == ("clear", 4)
    after = mvtn("cache", "--json").document["kinds"]
    assert after["shapes"]["files"] == 0 and after["datasets"] == shown["kinds"]["datasets"]
    assert mvtn("cache", "show").out.splitlines()[0] == "kind\tfiles\tsize"


def test_doctor_exits_with_1_only_if_something_needed_is_broken(mvtn: Mvtn, monkeypatch: pytest.MonkeyPatch):
    def fine(config: Any, call: Any) -> Iterator[Finding]:
        yield Finding("a", "ok", "good")
        yield Finding("b", "warn", "so so", "do this")

    def faints(config: Any, call: Any) -> Iterator[Finding]:
        raise ImportError("no module\nnamed x")
        yield

    monkeypatch.setattr(doctor_command, "CHECKS", (fine,))
    healthy = mvtn("doctor")
    assert healthy.code == 0 and healthy.out == "ok    a: good\nwarn  b: so so  (do this)\n"
    monkeypatch.setattr(doctor_command, "CHECKS", (fine, faints))
    sick = mvtn("doctor", "--json")
    assert sick.code == 1 and sick.error["code"] == "doctor.bad"
    assert [check["state"] for check in sick.document["checks"]] == ["ok", "warn", "bad"]
    assert sick.document["ok"] is False


def test_doctor_finds_this_machine_fit_and_an_unwritable_cache_not(
    mvtn: Mvtn, own_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    document = mvtn("doctor", "--json").document
    names = {check["name"] for check in document["checks"]}
    assert document["ok"] is True
    assert names >= {
        "python",
        "mvtn",
        "torch",
        "torchvision",
        "numba",
        "cuda",
        "threads",
        "renderer",
        "cache",
        "memory",
        "disk",
    }
    assert names >= {"imagenet weights", "terminal", "runs"}
    (own_folder / "file").write_text("")
    monkeypatch.setattr(doctor_command, "CHECKS", (doctor_command._cache,))
    result = mvtn("doctor", "--json", "--cache", "file/cache")
    assert result.code == 1
    assert [(check["name"], check["state"]) for check in result.document["checks"]] == [("cache", "bad")]
