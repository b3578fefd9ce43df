"""`mvtn report`: which runs a word means, what is written where, and what is said when it can't be."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from running import Outcome

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_up import make_run
from made_up_runs import small_run

Mvtn = Callable[..., Outcome]


@pytest.fixture
def runs(own_folder: Path) -> Path:
    """`runs` with a group of two and two others."""
    folder = own_folder / "runs"
    for seed in (0, 1):
        small_run(folder / "group" / f"fixed-s{seed}", seed=seed)
    small_run(folder / "m40-learned", skill=4.0, lr=0.1)
    small_run(folder / "m40-fixed", evaluated=False, lr=0.2)
    return folder


def names(result: Outcome) -> list[str]:
    assert result.code == 0, result.err
    return [Path(run["run"]).name for run in result.document["runs"]]


def test_the_report_of_one_run_is_written_again(own_folder: Path, mvtn: Mvtn):
    run = make_run(own_folder / "runs" / "one", ["chair", "table"], size=16, epochs=2)
    (run / "last.safetensors").touch()
    result = mvtn("report", "one")
    page = Path(result.out.strip())
    assert result.code == 0 and page == Path("runs/one/report.html")
    first = page.read_bytes()
    assert first.startswith(b"<!doctype html>")
    bare = mvtn("report", "--json", "-o", "elsewhere/page.html")
    assert bare.document["report"] == "elsewhere/page.html" and bare.document["schema"] == "mvtn.report/1"
    assert Path("elsewhere/page.html").read_bytes() == first and "run: runs/one (the latest)" in bare.err


def test_a_run_that_was_never_evaluated_is_told_how(runs: Path, mvtn: Mvtn):
    result = mvtn("report", "m40-fixed", "--json")
    assert result.code == 1 and result.error["code"] == "report.no-evaluation"
    assert result.error["hint"] == "make one first: mvtn eval runs/m40-fixed"
    assert not (runs / "m40-fixed" / "report.html").exists()


def test_several_runs_are_compared_on_one_page(runs: Path, mvtn: Mvtn):
    result = mvtn("report", "m40-learned", "group")
    assert result.code == 0 and result.out == "runs/comparison.html\n"
    assert "m40-learned\t" in result.err and "group/fixed-s0 recognises" in result.err
    text = Path("runs/comparison.html").read_text(encoding="utf-8")
    assert "mvtn report m40-learned group".replace(" ", "</span> <span>") in text
    again = mvtn("report", "m40-learned", "group", "-q")
    assert again.err == "" and Path("runs/comparison.html").read_text(encoding="utf-8") == text


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["group"], ["fixed-s0", "fixed-s1"]),
        (["runs/group", "group", "group/fixed-s0"], ["fixed-s0", "fixed-s1"]),
        (["m40-*"], ["m40-fixed", "m40-learned"]),
        (["runs/m40-*"], ["m40-fixed", "m40-learned"]),
        (["*/fixed-s?", "m40-learned"], ["fixed-s0", "fixed-s1", "m40-learned"]),
        (["runs"], ["fixed-s0", "fixed-s1", "m40-fixed", "m40-learned"]),
        (["*"], ["fixed-s0", "fixed-s1", "m40-fixed", "m40-learned"]),
        (["m40-learned", "group/fixed-s1"], ["m40-learned", "fixed-s1"]),
    ],
)
def test_runs_are_named_by_name_folder_or_pattern(runs: Path, mvtn: Mvtn, words: list[str], expected: list[str]):
    assert names(mvtn("report", *words, "--json", "-o", "page.html")) == expected


@pytest.mark.parametrize("word", ["m40-lerned", "nothing-*"])
def test_an_unknown_run_is_answered_with_those_there_are(runs: Path, mvtn: Mvtn, word: str):
    result = mvtn("report", "m40-fixed", word, "--json")
    assert result.code == 2 and result.error["code"] == "unknown-run" and "m40-learned" in result.error["hint"]
    assert not (runs / "comparison.html").exists()


def test_the_document_names_page_and_plot(runs: Path, mvtn: Mvtn):
    result = mvtn("report", "m40-*", "--output", "out/page.html", "--plot", "out/plot.svg", "--json")
    document = result.document
    assert document["schema"] == "mvtn.comparison/1"
    assert (document["page"], document["plot"]) == ("out/page.html", "out/plot.svg")
    assert Path("out/page.html").is_file() and Path("out/plot.svg").is_file()
    assert [run["evaluated"] for run in document["runs"]] == [False, True]
    told = "m40-fixed is not evaluated: mvtn eval runs/m40-fixed"
    assert document["warnings"] == [told] and f"warning: {told}" in result.err
    keys = {
        "schema",
        "runs",
        "settings",
        "groups",
        "data",
        "remarks",
        "versions",
        "command",
        "page",
        "plot",
        "warnings",
    }
    assert set(document) == keys


def test_a_plot_that_can_t_be_is_refused_before_anything_is_written(runs: Path, mvtn: Mvtn):
    wrong = mvtn("report", "m40-*", "--plot", "plot.pdf", "--json")
    assert wrong.code == 2 and wrong.error["message"] == "--plot plot.pdf: a plot is .svg or .png"
    single = mvtn("report", "m40-learned", "--plot", "plot.svg", "--json")
    assert single.code == 2 and "several runs" in single.error["message"]
    small_run(runs / "other", address="0000", spec="folder:there")
    mixed = mvtn("report", "m40-learned", "other", "--plot", "plot.svg", "--json")
    assert mixed.code == 2 and mixed.error["code"] == "report.data"
    assert not (runs / "comparison.html").exists() and not Path("plot.svg").exists()


def test_runs_on_several_data_sets_are_warned_about(runs: Path, mvtn: Mvtn):
    small_run(runs / "other", address="0000", spec="folder:there")
    result = mvtn("report", "m40-learned", "other")
    assert result.code == 0 and "warning: The runs stand on 2 data sets" in result.err
