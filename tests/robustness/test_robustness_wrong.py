"""What can't be measured is said in one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest
from solids import Toy
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.console import Console
from mvtn_cli.core.robustness import Corruption, measure
from mvtn_cli.errors import DataError
from mvtn_cli.robustness_config import RobustnessConfig


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")


@pytest.mark.parametrize(
    ("words", "message", "hint"),
    [
        (["--occlude", "1.5"], "--occlude must be less than 1, got 1.5", ""),
        (["--occlude", "-0.1"], "--occlude must be at least 0, got -0.1", ""),
        (["--occlude", "0.1,1"], "--occlude must be less than 1, got 1", ""),
        (["--occlude", "much"], "--occlude must be a number, got 'much'", ""),
        (["--occlude", "nan"], "--occlude must be a number, got nan", ""),
        (["--occlude", ""], "--occlude must be a number, got ''", ""),
        (["--drop-points", "1"], "--drop-points must be less than 1, got 1", ""),
        (["--rotate", "270"], "--rotate must be at most 180, got 270", ""),
        (["--noise", "-1"], "--noise must be at least 0, got -1", ""),
        (["--scale", "0"], "--scale must be more than 0, got 0", ""),
        (["--directions", "+x,up"], "unknown directions 'up'", "--directions is one of: +x, -x, +y, -y, +z, -z"),
        (["--directions", "-w"], "unknown directions '-w'; did you mean", "--directions is one of: +x, -x"),
        (["--crop", "exten"], "unknown crop 'exten'; did you mean 'extent'?", "--crop is one of: quantile, extent"),
        (["--repeats", "0"], "--repeats must be at least 1, got 0", ""),
        (["--limit", "0"], "--limit must be at least 1, got 0", ""),
        (["nothere"], "unknown run 'nothere'", "there is no run yet"),
    ],
)
def test_wrong_words(words: list[str], message: str, hint: str):
    result = CliRunner().invoke(app, ["robustness", *words])
    assert result.exit_code == 2 and result.stdout == ""
    said, *more = result.stderr.rstrip("\n").split("\n")
    assert said.startswith(f"error: {message}")
    assert "".join(more).strip().startswith(hint) and len(more) <= 1


def test_a_folder_without_runs_says_what_to_do_first():
    result = CliRunner().invoke(app, ["robustness"])
    assert result.exit_code == 1 and result.stderr == "error: no trained run in runs\n  train one first: mvtn train\n"


def test_a_run_without_weights_is_named(make_run):
    run = make_run(Toy())
    config = RobustnessConfig(device="cpu", checkpoint="last")
    with pytest.raises(DataError, match="run a has no last weights yet"):
        measure.measure([run], Toy(), [8, 9], [Corruption("clean")], config, Console(quiet=True))


def test_directions_have_short_names_and_lists_may_come_from_files():
    assert RobustnessConfig(directions="x,-y").directions == ("+x", "-y")
    assert RobustnessConfig(directions=["z"]).directions == ("+z",)
    assert RobustnessConfig(run="a,b").run == ("a,b",)
    assert RobustnessConfig(occlude=0.5).occlude == (0.5,)
