from __future__ import annotations

import json

import numpy as np
import pytest

from mvtn_cli.core.evaluation.files import read_csv, write_csv, write_json


def test_names_with_commas_quotes_and_line_breaks_survive_a_table(tmp_path):
    names = ["a,b", 'say "hi"', "two\nlines", "käse", " spaced "]
    path = write_csv(tmp_path / "new" / "t.csv", ["name", "value"], [(n, 1 / 3) for n in names])
    assert [row["name"] for row in read_csv(path)] == names
    assert read_csv(path)[0]["value"] == "0.333333"


def test_what_is_not_a_number_is_empty_in_a_table_and_null_in_a_document(tmp_path):
    table = write_csv(tmp_path / "t.csv", ["x", "y"], [(np.float32("nan"), None)])
    assert read_csv(table) == [{"x": "", "y": ""}]
    document = write_json(tmp_path / "d.json", {"x": float("inf"), "y": np.arange(2), "z": np.float64("nan")})
    assert json.loads(document.read_text()) == {"x": None, "y": [0, 1], "z": None}


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = write_json(tmp_path / "d.json", {"x": 1})
    with pytest.raises(TypeError):
        write_json(path, {"x": object()})
    assert json.loads(path.read_text()) == {"x": 1}
    assert list(tmp_path.glob("*")) == [path] and list(tmp_path.glob(".*.tmp")) == []
