"""Comparing selections of views: the statistics, and that finished work is not repeated."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats

from mvtn_cli.core.training.compare import compare, full_selection, paired_interval, summarise
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import DataError, Interrupted, UsageError


def test_the_paired_interval_is_the_one_of_students_t():
    a, b = [0.80, 0.85, 0.78, 0.90], [0.84, 0.86, 0.85, 0.91]
    wanted = stats.ttest_rel(b, a).confidence_interval(0.95)
    assert paired_interval(a, b) == pytest.approx((0.0325, wanted.low, wanted.high))


def test_the_paired_interval_on_paper():
    # differences 1, 2, 3: mean 2, standard error 1 / sqrt(3), t of two degrees of freedom 4.302653
    mean, low, high = paired_interval([0, 0, 0], [1, 2, 3])
    assert (mean, low, high) == pytest.approx((2, 2 - 4.302653 / np.sqrt(3), 2 + 4.302653 / np.sqrt(3)))


def test_a_common_shift_of_each_seed_does_not_widen_the_interval():
    _, low, high = paired_interval([0.2, 0.5, 0.9], [0.3, 0.6, 1.0])
    assert (low, high) == pytest.approx((0.1, 0.1))


def test_a_single_pair_has_a_mean_and_no_interval():
    assert paired_interval([1.0], [3.0]) == (2.0, None, None)
    assert summarise([0.5])["sd"] is None
    assert summarise([0.4, 0.6]) == {
        "accuracies": [0.4, 0.6],
        "mean": 0.5,
        "sd": pytest.approx(0.2 / np.sqrt(2)),
    }


def test_learned_means_learned_in_the_layout():
    assert full_selection("learned", "circular") == "learned-circular"
    assert full_selection("jittered", "icosahedral") == "jittered"
    with pytest.raises(UsageError, match="no learned icosahedral"):
        full_selection("learned", "icosahedral")
    with pytest.raises(UsageError, match="did you mean 'jittered'"):
        full_selection("jitered", "spherical")


def test_a_comparison_runs_all_pairs_and_repeats_nothing(settings, boxes, quiet):
    config = settings(epochs=1, name="cmp")
    table = compare(config, ["fixed", "learned"], 2, boxes, quiet)
    runs = [run for entry in table["selections"] for run in entry["runs"]]
    assert [Run.open(run).config.views for run in runs] == ["fixed"] * 2 + ["learned-spherical"] * 2
    assert [Run.open(run).config.seed for run in runs] == [0, 1, 0, 1]
    a, b = (entry["accuracies"] for entry in table["selections"])
    assert all(accuracy in (0, 0.25, 0.5, 0.75, 1) for accuracy in a + b)
    (difference,) = table["differences"]
    assert (difference["a"], difference["b"]) == ("fixed", "learned-spherical")
    assert difference["mean"] == pytest.approx(np.mean(b) - np.mean(a))
    assert json.loads((config.runs / "cmp" / "compare.json").read_text())["selections"] == table["selections"]

    changed = {run: (Run.open(run).path / "run.json").stat().st_mtime_ns for run in runs}
    assert compare(config, ["fixed", "learned"], 2, boxes, quiet) == table
    assert changed == {run: (Run.open(run).path / "run.json").stat().st_mtime_ns for run in runs}


def test_an_interrupted_comparison_goes_on(settings, boxes, quiet):
    config = settings(epochs=1)
    judged = []

    def interrupt(run: Run) -> float:
        judged.append(run.name)
        if len(judged) == 2:
            raise Interrupted("stop")
        return 0.5

    with pytest.raises(Interrupted):
        compare(config, ["fixed", "random"], 2, boxes, quiet, evaluate=interrupt)
    assert judged == ["fixed-s0", "random-s0"]
    table = compare(config, ["fixed", "random"], 2, boxes, quiet, evaluate=lambda run: 0.5)
    assert table["name"] == "compare-boxes-2v" and len(Run.all(config.runs)) == 4


def test_other_settings_begin_another_comparison_unless_it_has_a_name(settings, boxes, quiet):
    def names(**changed) -> str:
        return compare(settings(epochs=1, **changed), ["fixed", "random"], 2, boxes, quiet, evaluate=len_of_name)[
            "name"
        ]

    def len_of_name(run: Run) -> float:
        return len(run.name)

    assert [names(), names(lr=0.1), names(), names(lr=0.1)] == ["compare-boxes-2v", "compare-boxes-2v-2"] * 2
    assert names(name="mine") == "mine"
    with pytest.raises(UsageError, match=r"lr: 0\.003 → 0\.1"):
        names(name="mine", lr=0.1)


def test_a_comparison_without_test_shapes_says_so_before_it_trains(settings, boxes, quiet):
    boxes.records = [record for record in boxes.records if record.split != "test"]
    with pytest.raises(DataError, match="split 'test'"):
        compare(settings(), ["fixed", "random"], 2, boxes, quiet)
    assert not settings().runs.exists()


def test_what_cannot_be_trained_is_said_before_anything_is(settings, boxes, quiet, tmp_path):
    config = settings(network="pointnet", views="fixed")
    with pytest.raises(UsageError, match="looks at points alone"):
        compare(config, ["fixed", "learned"], 2, boxes, quiet)
    assert not (tmp_path / "runs").exists()
