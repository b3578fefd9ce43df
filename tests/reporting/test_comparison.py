"""Several runs side by side: the tests, the tables, and the page that is made of them."""

from __future__ import annotations

import json
import re
import sys
from fractions import Fraction
from math import comb
from pathlib import Path

import numpy as np
import pytest

from mvtn_cli.core.evaluation.files import read_csv, write_json
from mvtn_cli.core.reporting.comparison import compare_runs, write_comparison
from mvtn_cli.core.reporting.comparison_page import render_comparison, render_plot
from mvtn_cli.core.reporting.comparison_plots import Dot, accuracy_dots
from mvtn_cli.core.reporting.comparison_runs import Answers, labels_of
from mvtn_cli.core.reporting.comparison_tables import group_name
from mvtn_cli.core.reporting.comparison_tests import aligned, holm, mcnemar, points, sentence
from mvtn_cli.errors import DataError, UsageError

sys.path.insert(0, str(Path(__file__).parent))
from made_up_runs import CLASSES, evaluate, small_run
from test_report_html import Page

# McNemar's test


@pytest.mark.parametrize(("only_a", "only_b"), [(0, 0), (0, 1), (3, 3), (0, 6), (5, 15), (40, 41), (118, 423)])
def test_the_test_is_the_two_sided_sign_test_of_the_shapes_that_one_alone_recognises(only_a: int, only_b: int):
    a = np.array([True] * only_a + [False] * only_b + [True] * 7 + [False] * 4)
    b = np.array([False] * only_a + [True] * only_b + [True] * 7 + [False] * 4)
    n = only_a + only_b
    tail = sum(Fraction(comb(n, k), 2**n) for k in range(min(only_a, only_b) + 1))
    found = mcnemar(a, b)
    assert found["p"] == pytest.approx(float(min(Fraction(1), 2 * tail)), rel=1e-9)
    assert (found["only_a"], found["only_b"], found["count"]) == (only_a, only_b, len(a))
    assert found["difference"] == pytest.approx(b.mean() - a.mean())
    turned = mcnemar(b, a)
    assert turned["p"] == pytest.approx(found["p"]) and turned["difference"] == -found["difference"]


def test_the_test_errs_about_as_often_as_it_says():
    random = np.random.default_rng(0)
    values = [mcnemar(*(random.random((2, 200)) < 0.8))["p"] for _ in range(400)]
    assert np.mean(np.array(values) < 0.05) < 0.08


def test_holm_s_correction_is_that_of_the_book():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0] and holm([0.2]) == [0.2] and holm([]) == []


def test_answers_are_paired_by_shape_whatever_their_order():
    shapes = tuple((f"chair/{i}", "chair") for i in range(6))
    right = np.array([1, 0, 1, 1, 0, 0], bool)
    order = [3, 1, 5, 0, 2, 4]
    other = Answers(tuple(shapes[i] for i in order), right[order])
    both = aligned(Answers(shapes, right), other)
    assert both is not None and (both[0] == both[1]).all()
    fewer = Answers(shapes[:5], right[:5])
    assert aligned(Answers(shapes, right), fewer) is None and aligned(fewer, other) is None
    twice = Answers((*shapes[:5], shapes[0]), right)
    assert aligned(twice, other) is None and aligned(other, twice) is None


def test_a_sentence_names_the_better_one_and_says_what_many_pairs_do():
    test = {"a": "old", "b": "new", "only_a": 20, "only_b": 5, "count": 100, "difference": -0.15, "p": 0.004}
    assert sentence({**test, "p_holm": 0.02}, 5) == (
        "old recognises 20 shapes that new does not, and the other way round 5: 15.0 points ahead, "
        "more than chance explains (p = 0.004)."
    )
    assert "among 30 pairs it may be chance" in sentence({**test, "p_holm": 0.12}, 30)
    assert "may well be chance (p = 0.40)" in sentence({**test, "p": 0.4, "p_holm": 0.4}, 1)
    assert "neither is ahead" in sentence({**test, "only_a": 5, "p_holm": 1.0}, 1)
    assert "exactly the same shapes" in sentence({**test, "only_a": 0, "only_b": 0, "p_holm": 1.0}, 1)
    assert [points(x) for x in (0.0123, -0.0123, 0.0001, -0.0001)] == ["+1.2", "−1.2", "0.0", "0.0"]


# Names


def test_names_are_as_short_as_can_be_and_differ(tmp_path: Path):
    assert labels_of([tmp_path / "a" / "x", tmp_path / "a" / "y"]) == ["x", "y"]
    assert labels_of([tmp_path / "a" / "x", tmp_path / "b" / "x"]) == ["a/x", "b/x"]
    assert labels_of([tmp_path / "a", tmp_path / "a" / "x"]) == ["a", "x"]
    assert labels_of([tmp_path / "a"]) == ["a"]


def test_a_group_is_called_what_its_runs_are_without_their_seeds():
    assert group_name(["fixed-s0", "fixed-s1"], [0, 1]) == "fixed"
    assert group_name(["views-3-s10", "views-3-s11"], [10, 11]) == "views-3"
    assert group_name(["g/run_seed_1", "g/run_seed_2"], [1, 2]) == "g/run"
    assert group_name(["spheres-s0"], [0]) == "spheres-s0"
    assert group_name(["a", "b", "c", "d"], range(4)) == "a, b and 2 more"


# What is compared


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    """Two ways with two seeds each."""
    kinds = [("fixed", 0), ("fixed", 1), ("learned-spherical", 0), ("learned-spherical", 1)]
    return [
        small_run(tmp_path / f"{views}-s{seed}", views=views, seed=seed, skill=2.0 + ("learned" in views), lr=0.0005)
        for views, seed in kinds
    ]


def test_the_document_says_what_the_files_of_the_runs_say(runs: list[Path]):
    document = compare_runs(runs)
    assert [run["name"] for run in document["runs"]] == [run.name for run in runs]
    for entry, run in zip(document["runs"], runs, strict=True):
        result = json.loads((run / "result.json").read_text())
        for key in ("accuracy", "accuracy_interval", "class_accuracy", "count", "correct"):
            assert entry[key] == result[key]
        assert (entry["seconds"], entry["epochs"], entry["parameters"]) == (16.0, 8, 1234)
        assert [point["seconds"] for point in entry["curve"]] == [2.0 * i for i in range(1, 9)]
        assert (entry["views"], entry["num_views"], entry["image_size"]) == (run.name[:-3], 3, 32)
    assert document["settings"] == [
        {"setting": "views", "values": ["fixed", "fixed", "learned-spherical", "learned-spherical"]},
        {"setting": "seed", "values": ["0", "1", "0", "1"]},
    ]
    assert document["remarks"] == []


def test_runs_that_differ_in_their_seed_alone_are_a_group(runs: list[Path]):
    document = compare_runs(runs)
    assert [group["name"] for group in document["groups"]] == ["fixed", "learned-spherical"]
    assert [run["group"] for run in document["runs"]] == [0, 0, 1, 1]
    shares = [run["accuracy"] for run in document["runs"]]
    for group, own in zip(document["groups"], (shares[:2], shares[2:]), strict=True):
        assert group["accuracy"]["mean"] == pytest.approx(np.mean(own))
        assert group["accuracy"]["sd"] == pytest.approx(np.std(own, ddof=1)) and group["accuracy"]["n"] == 2


def test_a_seed_that_comes_again_is_no_further_seed(tmp_path: Path):
    names = ["plain-s0", "plain-s1", "patched-s0", "patched-s1", "patched-s2"]
    runs = [small_run(tmp_path / name, seed=int(name[-1]), skill=1.0 + name.startswith("pa")) for name in names]
    document = compare_runs(runs)
    assert [(group["name"], group["seeds"]) for group in document["groups"]] == [
        ("plain", [0, 1]),
        ("patched", [0, 1, 2]),
    ]
    assert document["remarks"] == [
        "plain-s0 and patched-s0 (and 1 pair more) have the same settings and seed and yet other accuracies: what "
        "differs is no setting, such as the version of a program or the kind of machine."
    ]
    assert compare_runs(runs[:2])["remarks"] == []
    repeated = compare_runs([runs[0], small_run(tmp_path / "again", skill=1.0)])
    assert [group["seeds"] for group in repeated["groups"]] == [[0], [0]] and repeated["remarks"] == []


def test_classes_and_mistakes_that_differ_most_come_first(runs: list[Path]):
    data = compare_runs(runs)["data"][0]
    assert data["compared"] == [run.name for run in runs]
    rows = {row["name"]: row for row in data["classes"]}
    assert set(rows) == set(CLASSES)
    spreads = [row["spread"] for row in data["classes"]]
    assert spreads == sorted(spreads, reverse=True) and spreads[0] > spreads[-1]
    answers = [read_csv(run / "predictions.csv") for run in runs]
    for name, row in rows.items():
        own = [[line["correct"] == "1" for line in lines if line["label"] == name] for lines in answers]
        assert row["accuracies"] == pytest.approx([np.mean(right) for right in own])
        assert row["spread"] == pytest.approx(max(row["accuracies"]) - min(row["accuracies"]))
    assert data["confusions"]
    for row in data["confusions"]:
        pair = row["label"], row["predicted"]
        counts = [sum((line["label"], line["predicted"]) == pair for line in lines) for lines in answers]
        assert row["counts"] == counts and row["spread"] == max(counts) - min(counts) > 1
    assert [row["spread"] for row in data["confusions"]] == sorted(
        (row["spread"] for row in data["confusions"]), reverse=True
    )


def test_every_pair_is_tested_on_the_same_shapes(runs: list[Path]):
    tests = compare_runs(runs)["data"][0]["tests"]
    assert len(tests) == 6 and [test["p"] for test in tests] == sorted(test["p"] for test in tests)
    answers = {run.name: [line["correct"] == "1" for line in read_csv(run / "predictions.csv")] for run in runs}
    for test in tests:
        a, b = np.array(answers[test["a"]]), np.array(answers[test["b"]])
        assert (test["only_a"], test["only_b"]) == ((a & ~b).sum(), (b & ~a).sum())
        assert test["p"] <= test["p_holm"] <= min(1.0, 6 * test["p"]) + 1e-12


# What can't be compared


def test_a_run_without_evaluation_has_its_curve_and_the_command(runs: list[Path]):
    bare = small_run(runs[0].parent / "bare one", evaluated=False, state="interrupted")
    document = compare_runs([runs[0], bare])
    entry = document["runs"][1]
    assert not entry["evaluated"] and entry["accuracy"] is None and len(entry["curve"]) == 8
    assert entry["evaluate"] == f"mvtn eval '{bare}'"
    text = Page(render_comparison({**document, "command": ""}, bare.parent / "page.html")).text
    assert "not evaluated" in " ".join(text) and "training interrupted" in " ".join(text)


def test_runs_of_a_comparison_or_sweep_have_its_accuracies(tmp_path: Path):
    compared = [small_run(tmp_path / "c" / f"fixed-s{i}", seed=i, evaluated=False) for i in range(2)]
    rows = [{"selection": "fixed", "accuracies": [0.5, 0.75], "runs": [f"runs/c/{run.name}" for run in compared]}]
    write_json(tmp_path / "c" / "compare.json", {"split": "test", "selections": rows})
    swept = small_run(tmp_path / "s" / "one", evaluated=False, lr=0.1)
    old = small_run(tmp_path / "s" / "old", evaluated=False, lr=0.2)
    found = [
        {"run": "s/one", "accuracy": 0.625, "class_accuracy": 0.5, "changed": 5.0},
        {"run": "s/old", "accuracy": 0.625, "class_accuracy": 0.5, "changed": 4.0},
    ]
    write_json(tmp_path / "s" / "sweep.json", {"split": "test", "cells": [{"runs": found}]})
    document = compare_runs([*compared, swept, old])
    assert [run["accuracy"] for run in document["runs"]] == [0.5, 0.75, 0.625, None]
    assert [run["source"] for run in document["runs"]] == ["compare.json", "compare.json", "sweep.json", None]
    assert document["groups"][0]["accuracy"]["mean"] == 0.625
    (tmp_path / "c" / "compare.json").write_text('{"selections": [{"runs": 3}]}')
    assert compare_runs(compared)["runs"][0]["accuracy"] is None


def test_runs_on_several_data_sets_are_compared_within_each(runs: list[Path]):
    other = [
        small_run(runs[0].parent / f"o{i}", address="0000", spec="/somewhere/meshes", skill=i, lr=i) for i in (1.0, 4.0)
    ]
    document = compare_runs([*runs, *other])
    assert [data["runs"] for data in document["data"]] == [[run.name for run in runs], ["o1.0", "o4.0"]]
    pairs = {frozenset((test["a"], test["b"])) for data in document["data"] for test in data["tests"]}
    assert len(pairs) == 7 and not any({"o1.0", "fixed-s0"} <= pair for pair in pairs)
    assert document["remarks"][0].startswith("The runs stand on 2 data sets, builtin:shapes (4 runs), meshes (2 runs)")
    ids = Page(render_comparison({**document, "command": ""}, runs[0].parent / "page.html")).ids
    assert len(ids) == len(set(ids)), "also those of the plots of both"
    with pytest.raises(UsageError, match="one plot can't compare runs on 2 data sets"):
        render_plot(document, "svg")


def test_another_split_stays_out_of_what_single_shapes_say(runs: list[Path]):
    small_run(runs[0].parent / "val", split="val", lr=0.3)
    document = compare_runs([*runs, runs[0].parent / "val"])
    data = document["data"][0]
    assert data["others"] == ["val"] and "val" not in data["compared"] and data["split"] == "test"
    assert document["remarks"][0].startswith("val: judged on other shapes than most, which are the test split")


def test_what_is_older_or_measured_otherwise_is_said(runs: list[Path]):
    evaluate(runs[0], 0, 2.0, best=3)
    for run, metric in zip(runs, ("euclidean", "cosine"), strict=False):
        (run / "retrieval").mkdir()
        write_json(run / "retrieval" / "result.json", {"micro": {"ap": 0.5}, "metric": metric})
    for run, count in zip(runs, (100, 200), strict=False):
        measured = {"clean": {"accuracy": 0.8}, "corruptions": [{"kind": "rotate", "strength": 90.0, "mean": 0.7}]}
        write_json(run / "robustness.json", {"count": count, "runs": [measured]})
    (runs[2] / "predictions.csv").unlink()
    document = compare_runs(runs)
    assert [run["outdated"] for run in document["runs"]] == [True, False, False, False]
    assert [bool(run["retrieval"]) for run in document["runs"]] == [True, True, False, False]
    told = " ".join(document["remarks"])
    assert "mAP with care" in told and "those columns with care" in told
    assert "learned-spherical-s0: no predictions.csv" in told
    assert len(document["data"][0]["tests"]) == 3
    text = " ".join(Page(render_comparison({**document, "command": ""}, runs[0].parent / "page.html")).text)
    assert "trained on since its evaluation" in text and "rotate 90°" in text


def test_files_that_are_broken_are_as_if_missing_but_a_run_is_needed(runs: list[Path]):
    (runs[0] / "result.json").write_text('{"accuracy": 0.5}')
    (runs[1] / "predictions.csv").write_text("nothing\n1\n")
    document = compare_runs(runs)
    assert [run["evaluated"] for run in document["runs"]] == [False, True, True, True]
    assert len(document["data"][0]["tests"]) == 1
    (runs[3] / "run.json").write_text("{")
    with pytest.raises(DataError, match=r"can't read .*run\.json"):
        compare_runs(runs)


# The page


def test_the_page_is_whole_offline_and_the_same_each_time(runs: list[Path]):
    (runs[1] / "report.html").write_text("one")
    page = runs[0].parent / "out" / ".." / "comparison.html"
    write_comparison(runs, page, "mvtn report runs")
    text = page.read_text(encoding="utf-8")
    found = Page(text)
    assert found.ids == list(dict.fromkeys(found.ids))
    links = [value for _, name, value in found.attributes if name in ("href", "src")]
    assert set(links) == {"fixed-s1/report.html"} and "http:" not in text and "https:" not in text
    assert "class &lt;5&gt; &amp; more" in text and "class <5>" not in text
    assert {"runs", "curves", "settings", "seeds", "pairs", "classes", "confusions"} <= set(found.ids)
    write_comparison(runs, page, "mvtn report runs")
    assert page.read_text(encoding="utf-8") == text
    elsewhere = runs[0].parent / "deeper" / "comparison.html"
    assert '<a href="' not in render_comparison({**compare_runs(runs), "command": ""}, elsewhere)


def test_names_stand_in_plots_as_they_are(tmp_path: Path):
    names = ["lr-0.0005$a$", "lr-0.00050001 <b>", "x" * 60]
    dots = [Dot(i, i, name, 0.5 + i / 10, (0.4, 0.9)) for i, name in enumerate(names)]
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", accuracy_dots(dots, 3, "test accuracy"))
    assert "0 lr-0.0005$a$" in [re.sub(r"\s+", " ", text) for text in texts]
    assert any(text.endswith("lr-0.00050001 &lt;b&gt;") for text in texts)
    assert any("x…x" in text and len(text) < 45 for text in texts)


@pytest.mark.parametrize("count", [1, 12])
def test_few_and_many_runs_have_a_page(tmp_path: Path, count: int):
    runs = [small_run(tmp_path / f"r{i}", seed=0, lr=0.001 * (i + 1), skill=2 + i / 10, epochs=1) for i in range(count)]
    document = compare_runs(runs)
    text = render_comparison({**document, "command": ""}, tmp_path / "page.html")
    Page(text)
    assert len(text) < 1_000_000 and len(document["data"][0]["tests"]) == count * (count - 1) // 2
    assert ("smallest p; all 66 stand" in text) == (count == 12)


@pytest.mark.parametrize(("name", "start"), [("plot.svg", b"<?xml"), ("plot.PNG", b"\x89PNG")])
def test_the_plot_alone_has_the_same_bytes_each_time(runs: list[Path], name: str, start: bytes):
    plot, page = runs[0].parent / name, runs[0].parent / "page.html"
    document = write_comparison(runs, page, plot=plot)
    first = plot.read_bytes()
    assert document["plot"] == str(plot) and first.startswith(start)
    write_comparison(runs, page, plot=plot)
    assert plot.read_bytes() == first
    if name.endswith("svg"):
        assert b">fixed<" in first and b">learned-spherical<" in first and b"Made-up set" in first


def test_without_epochs_there_is_nothing_to_plot(tmp_path: Path):
    runs = [small_run(tmp_path / f"r{i}", epochs=0, lr=i + 1.0) for i in range(2)]
    document = compare_runs(runs)
    assert "validation accuracy (%)" not in render_comparison({**document, "command": ""}, tmp_path / "page.html")
    with pytest.raises(UsageError, match="nothing to plot"):
        render_plot(document, "svg")
