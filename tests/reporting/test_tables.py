from __future__ import annotations

from mvtn_cli.core.evaluation.classification import metrics
from mvtn_cli.core.reporting import words
from mvtn_cli.core.reporting.tables import CLASS_COLUMNS, class_rows, compare_table, summary_rows


def result() -> dict:
    found = metrics([0, 0, 1, 1], [[1, 0], [0, 1], [0, 1], [0, 1]], ["chair", "sofa"])
    return {**found, "split": "test", "known_view": None, "baseline": {"accuracy": 0.5, "accuracy_sd": 0.01}}


def test_rows_for_the_terminal_say_what_was_measured():
    rows = dict(summary_rows(result()))
    assert rows["test accuracy"].startswith("75.0\u202f%") and rows["class accuracy"] == "75.0\u202f%"
    assert rows["histogram forest"] == "50.0\u202f% ± 1.0\u202f%"
    assert class_rows(result())[0] == ("chair", "2", "1", "50.0\u202f%", "sofa (1)")
    assert all(len(row) == len(CLASS_COLUMNS) for row in class_rows(result()))


def test_a_table_keeps_its_columns_whatever_stands_in_its_cells():
    rows = [{"views": "a|b\nc", "mean": 0.91234, "n": 3}, {"views": "d", "mean": float("nan"), "n": None}]
    lines = compare_table(rows).splitlines()
    assert lines[1] == "| --- | ---: | ---: |"
    assert lines[2] == r"| a\|b c | 0.9123 | 3 |" and lines[3] == "| d | – | – |"
    assert compare_table(rows, "tsv").splitlines()[1] == "a|b c\t0.9123\t3"
    assert compare_table([]) == ""


def test_numbers_are_said_as_people_write_them():
    assert words.degrees(-0.04) == "0.0°" and words.degrees(-12.0, 0) == "−12°"
    assert words.percent(float("nan")) == words.DASH and words.percent(None) == words.DASH
    assert words.span(0.885, 0.961) == "88–96\u202f%"
    assert words.count(12345) == "12\u202f345"
