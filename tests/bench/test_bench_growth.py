"""How whole commands grow: what is measured, what is fitted, and that an interruption costs one stage."""

from __future__ import annotations

import csv
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.console import Console
from mvtn_cli.core.bench import growth, growth_stages
from mvtn_cli.core.bench.growth import SMALLEST, STAGES, exponent, measure_growth
from mvtn_cli.core.bench.growth_plot import draw_growth
from mvtn_cli.core.bench.growth_stages import Spent, run_stage
from mvtn_cli.core.bench.plan import plan_for
from mvtn_cli.core.bench.remembered import FILE
from mvtn_cli.errors import MvtnError

QUIET = Console(quiet=True)
SETTINGS = {"image_size": 32, "views": 2, "seed": 0, "threads": 1}
weighs = pytest.mark.skipif(not hasattr(os, "wait4"), reason="this system does not tell what a process took")


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Stages that take no time and say what they took: a start, and more by a power of the shapes."""
    ran: list[tuple[str, int]] = []
    powers = {"preprocess": 1.0, "train": 1.0, "eval": 1.5, "retrieve": 2.0}

    def run(stage: str, size: int, folder: Path, settings: Any) -> Spent:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "shapes").write_text(stage)
        ran.append((stage, size))
        cpu = 3.0 + 0.007 * max(size - SMALLEST, 0) ** powers[stage]
        return Spent(cpu, 2 * cpu, 100.0 + size, 1e-6 * size**2 if stage == "retrieve" else None)

    monkeypatch.setattr(growth, "run_stage", run)
    return ran


def plan(work: Path, sizes: tuple[int, ...] = (100, 1000, 10_000), **more: Any) -> Any:
    return plan_for("growth", work=work, sizes=sizes, **more)


@pytest.mark.parametrize("power", [0.0, 0.7, 1.0, 2.0])
def test_an_exponent_is_the_slope_of_the_logarithms(power: float):
    sizes = [100, 1000, 10_000]
    assert exponent(sizes, [3.7 * size**power for size in sizes]) == pytest.approx(power, abs=1e-9)
    assert exponent(sizes[:1], [1.0]) is None and exponent([], []) is None
    assert exponent(sizes, [0.0, 1.0, 2.0]) is None


def test_the_start_is_told_apart_from_what_grows(stages, tmp_path):
    outcome = measure_growth(plan(tmp_path / "w"), QUIET)
    found = outcome.summary
    for stage, power in (("preprocess", 1), ("train", 1), ("eval", 1.5), ("retrieve", 2)):
        assert found[f"{stage}_above_start"] == pytest.approx(power, abs=1e-6)
    assert 0.3 < found["train"] < 0.9  # which the start hides
    assert found["ranking"] == pytest.approx(2, abs=1e-9) and "ranking_above_start" not in found
    assert 0 < found["train_memory"] < 1
    row = next(row for row in outcome.rows if (row["stage"], row["shapes"]) == ("train", 1000))
    assert (row["cpu_seconds"], row["seconds"], row["peak_mib"]) == (pytest.approx(9.832), pytest.approx(19.664), 1100)
    assert row["ms_per_shape"] == pytest.approx(7)
    # a hundred shapes are too few to rise clearly above a start of seconds
    clear = {(row["stage"], row["shapes"]): row["clear"] for row in outcome.rows}
    assert not clear["train", 100] and clear["train", 1000] and not clear["train", SMALLEST]


def test_an_interruption_costs_one_stage_and_nothing_is_measured_twice(stages, tmp_path, monkeypatch):
    work = tmp_path / "w"
    run = growth.run_stage

    def interrupted(stage: str, size: int, *more: Any) -> Spent:
        if (stage, size) == ("eval", 100):
            raise KeyboardInterrupt
        return run(stage, size, *more)

    monkeypatch.setattr(growth, "run_stage", interrupted)
    with pytest.raises(KeyboardInterrupt):
        measure_growth(plan(work, (100,)), QUIET)
    assert (work / "100" / "shapes").exists()
    with (work / FILE).open("a") as file:
        file.write('{"about": {}, "size": 100, "stage": "eval", "spent": {"cpu"')  # killed while writing
        file.write("\n")
    monkeypatch.setattr(growth, "run_stage", run)
    done = len(stages)
    outcome = measure_growth(plan(work, (100,)), QUIET)
    assert stages[done:] == [("eval", 100), ("retrieve", 100)]
    assert sorted(path.name for path in work.iterdir()) == [FILE]
    again = measure_growth(plan(work, (100,)), QUIET)
    assert len(stages) == done + 2 and again.rows == outcome.rows
    measure_growth(plan(work, (100,), num_views=2), QUIET)  # another thing altogether
    assert len(stages) == done + 2 + 3 * len(STAGES)


@weighs
def test_a_process_is_weighed_without_the_memory_of_whoever_starts_it(tmp_path):
    ours = np.ones(50 << 20)  # 400 MiB
    spent = []
    for mib in (0, 150):
        command = [sys.executable, "-c", f"x = bytearray({mib} << 20); x[::4096] = x[::4096]; sum(range(3000000))"]
        with (tmp_path / "out").open("wb") as out:
            spent.append(growth_stages._weighed(command, tmp_path, dict(os.environ), out, out))
    assert ours.sum() == len(ours)
    (code, cpu, peak), (_, _, more) = spent
    assert code == 0 and cpu > 0.01 and 2 < peak < 100 and 140 < more - peak < 160


@weighs
def test_a_stage_is_the_real_command_in_a_folder_of_its_own(tmp_path):
    spent = run_stage("preprocess", 6, tmp_path / "f", SETTINGS)
    assert 0 < spent.cpu <= 1.5 * spent.wall + 1 and 30 < spent.peak_mib < 600 and spent.ranking is None
    document = json.loads((tmp_path / "f" / "preprocess.json").read_text())
    assert document["dataset"] == "builtin:shapes?train=4&test=2" and document["kept"] == 6
    assert len(list((tmp_path / "f" / "cache" / "shapes").rglob("*.npz"))) == 6


def test_a_stage_that_fails_says_why(tmp_path):
    with pytest.raises(MvtnError, match=r"mvtn preprocess of 0 shapes failed: .* asks for no shapes") as caught:
        run_stage("preprocess", 0, tmp_path / "f", SETTINGS)
    assert str(tmp_path / "f" / "preprocess.err") in caught.value.hint


def test_the_command_gives_a_table_a_document_rows_and_a_plot(stages, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["bench", "growth", "--sizes", "100,1000", "--csv", "g.csv", "--plot", "g.svg"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.stderr
    header, *lines = result.stdout.splitlines()
    assert header.split("\t")[:3] == ["stage", "shapes", "cpu_seconds"] and len(lines) == 3 * (len(STAGES) + 1)
    with open("g.csv", encoding="utf-8", newline="") as file:
        assert len(list(csv.DictReader(file))) == len(lines)
    assert "peak memory" in Path("g.svg").read_text() and "preprocess" in Path("g.svg").read_text()
    document = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)
    assert document["command"] == "mvtn bench growth --sizes 100,1000 --seed 0"
    assert document["settings"] == {"image_size": 32, "views": 4, "seed": 0, "threads": 1}
    assert Path("growth", FILE).exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["gradient", "--sizes", "100"], "--sizes belongs to mvtn bench growth"),
        (["gradient", "--work", "x"], "--work belongs to mvtn bench growth"),
        (["growth", "--mesh", "a.off"], "built-in shapes"),
        (["growth", "--sizes", "10"], "sizes"),
    ],
)
def test_what_does_not_go_together_is_refused(words: list[str], told: str):
    result = CliRunner().invoke(app, ["bench", *words])
    assert result.exit_code == 2 and told in result.stderr


def test_a_plot_leaves_out_what_no_system_told(tmp_path):
    rows = [{"stage": "train", "shapes": n, "cpu_seconds": None, "seconds": n / 10, "peak_mib": None} for n in (24, 99)]
    draw_growth(tmp_path / "a" / "plot.png", rows)
    assert (tmp_path / "a" / "plot.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.slow
def test_all_stages_run(tmp_path):
    outcome = measure_growth(plan(tmp_path / "w", (30,)), QUIET)
    assert {row["stage"] for row in outcome.rows} == {*STAGES, "ranking"} and all(
        row["seconds"] for row in outcome.rows
    )
