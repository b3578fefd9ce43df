"""The benchmark of retrieval measures what it says."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.console import Console
from mvtn_cli.core.bench.retrieval import measure_retrieval


def test_the_benchmark_has_its_figures_and_repeats_by_seed():
    quiet = Console(quiet=True)
    (row,), again = (measure_retrieval(quiet, queries=30, gallery=400, dim=8, seed=s).rows for s in (3, 3))
    assert (row["queries"], row["gallery"], row["dim"]) == (30, 400, 8)
    assert row["map"] == again[0]["map"] and 0 < row["map"] < 0.5 and row["seconds"] > 0
    outcome = measure_retrieval(quiet, queries=30, gallery=400, dim=8, seed=4)
    assert outcome.summary["exact_seconds"] == outcome.rows[0]["seconds"] and outcome.rows[0]["map"] != row["map"]


def test_the_command_takes_sizes_and_says_how_to_repeat_it():
    words = ["bench", "retrieval", "--queries", "20", "--gallery", "90", "--dim", "4", "--json"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["what"] == "retrieval" and document["rows"][0]["gallery"] == 90
    assert document["summary"]["exact_seconds"] > 0 and "--queries 20 --gallery 90 --dim 4" in document["command"]
    assert len(document["reduced"]) == 3


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["gradient", "--dim", "3"], "--dim belongs to mvtn bench retrieval"),
        (["retrieval", "--mesh", "a.off"], "retrieval is measured with random numbers"),
        (["retrieval", "--queries", "0"], "--queries must be at least 1, got 0"),
        (["retrieval", "--plot", "a.png"], "measures no error"),
    ],
)
def test_sizes_that_make_no_sense_are_refused(words: list[str], told: str):
    done = CliRunner().invoke(app, ["bench", *words])
    assert done.exit_code == 2 and told in done.stderr
