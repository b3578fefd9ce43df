"""`mvtn robustness` as a user has it: bare, of several runs, stopped in the middle, and asked for the impossible."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import time
from pathlib import Path

import pytest
from demonstration import Demo
from processes import PATIENCE, Ended, Folder, finish

CELLS = "robustness.cells.jsonl"
SMALL = ("--rotate", "90,180", "--occlude", "0.5", "--repeats", "2")  # 1 + 4 + 6 evaluations


@pytest.fixture
def played(demo: Demo, tmp_path: Path) -> Folder:
    """The demo's folder and artifacts, to be changed at will."""
    folder = Folder(tmp_path / "played")
    shutil.copytree(demo.folder.path, folder.path)
    shutil.copytree(demo.folder.cache, folder.cache)
    return folder


def run_of(folder: Folder) -> Path:
    """The folder of the only run."""
    (run,) = folder.path.glob("runs/*/run.json")
    return run.parent


def cells_of(folder: Folder) -> list[dict]:
    """The finished evaluations of the only run."""
    path = run_of(folder) / CELLS
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def test_bare_it_measures_the_papers_corruptions_of_the_latest_run(played: Folder, demo: Demo):
    ended = played.mvtn("robustness", "--json")
    assert ended.code == 0, ended.err
    run = run_of(played)
    assert f"run: runs/{run.name} (the latest)" in ended.err and "51 evaluations on 12 test shapes, seed 0" in ended.err
    answer = ended.document
    assert answer["schema"] == "mvtn.robustness/1" and answer["warnings"] == [] and answer["count"] == 12
    (one,) = answer["runs"]
    assert one["clean"]["accuracy"] == json.loads((run / "result.json").read_text())["accuracy"]
    assert [(entry["kind"], entry["strength"], entry["evaluations"]) for entry in one["corruptions"]] == [
        *(("rotate", angle, 10) for angle in (90, 180)),
        *(("occlude", ratio, 6) for ratio in (0.1, 0.2, 0.3, 0.5, 0.75)),
    ]
    assert set(one["corruptions"][-1]["by"]) == {"+x", "-x", "+y", "-y", "+z", "-z"}
    assert one["corruptions"][-1]["points_left"] == 0.25
    written = json.loads((run / "robustness.json").read_text())
    assert written["runs"] == answer["runs"]
    rows = list(csv.DictReader((run / "robustness.csv").open()))
    assert len(rows) == 51 and {row["direction"] for row in rows if row["kind"] == "occlude"} == set(
        one["corruptions"][-1]["by"]
    )
    assert (run / "robustness.svg").read_text().startswith("<?xml")
    assert (run / "robustness.png").read_bytes()[1:4] == b"PNG"


def test_several_runs_become_the_rows_of_a_table(played: Folder):
    run = run_of(played)
    shutil.copytree(run, run.parent / "other")
    words = ("--so3", "--occlude", "0.3", "--directions", "-x,y", "--noise", "0.02", "--repeats", "2", "--limit", "6")
    ended = played.mvtn("robustness", run.name, "runs/other", *words)
    assert ended.code == 0, ended.err
    table = [line.split("\t") for line in ended.out.splitlines()]
    assert table[0] == ["run", "clean", "so3", "occlude 0.3", "noise 0.02"]
    assert [row[0] for row in table[1:3]] == [run.name, "other"] and " ± " in table[1][2]
    assert table[1][1:] == table[2][1:]  # the same weights on the same seeds
    assert table[3] == ["run", "share", "-x", "+y"] and len(table) == 6
    for folder, count in ((played.path / "runs" / "robustness", 2), (run, 1), (run.parent / "other", 1)):
        assert len(json.loads((folder / "robustness.json").read_text())["runs"]) == count


LONG = ("--rotate", "90", "--repeats", "100", "--limit", "6")  # enough to be stopped in, also on a busy machine
EVALUATIONS = 101


def stop(folder: Folder, number: signal.Signals, after: int) -> Ended:
    """Start a measurement and send it a signal once so many evaluations are written down."""
    process = folder.start("mvtn", "robustness", *LONG)
    try:
        deadline = time.monotonic() + PATIENCE
        while len(cells_of(folder)) < after:
            assert process.poll() is None and time.monotonic() < deadline, "it never came that far"
            time.sleep(0.002)
    finally:
        process.send_signal(number)
    return finish(process)


def test_however_it_is_stopped_the_same_command_goes_on_where_it_was(played: Folder):
    interrupted = stop(played, signal.SIGINT, 2)
    assert interrupted.code == 130 and interrupted.out == ""
    assert interrupted.error == ("interrupted", "the same command goes on where it stopped")
    first = cells_of(played)
    assert 2 <= len(first) < EVALUATIONS - 2
    killed = stop(played, signal.SIGKILL, len(first) + 1)
    assert killed.code == -signal.SIGKILL
    second = cells_of(played)
    assert len(first) < len(second) < EVALUATIONS and second[: len(first)] == first
    gone_on = played.mvtn("robustness", *LONG, "--json")
    assert gone_on.code == 0 and f"{len(second)} of {EVALUATIONS} evaluations were finished before" in gone_on.err
    assert cells_of(played)[: len(second)] == second
    assert len({cell["key"] for cell in cells_of(played)}) == len(cells_of(played)) == EVALUATIONS


def test_runs_of_different_data_are_refused(played: Folder):
    run = run_of(played)
    other = run.parent / "other"
    shutil.copytree(run, other)
    info = json.loads((other / "run.json").read_text())
    (other / "run.json").write_text(json.dumps({**info, "data_address": "x", "dataset": "builtin:one-sided"}))
    ended = played.mvtn("robustness", run.name, "other")
    assert ended.code == 2
    assert ended.error[0] == (
        f"runs/{run.name} was trained on {info['dataset']} and runs/other on builtin:one-sided, "
        "so that they share no test shapes"
    )
