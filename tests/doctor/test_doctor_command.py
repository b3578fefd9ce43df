"""`mvtn doctor DATASET` on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from release_writers import box_off, objects_release, off_release, put
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.commands import doctor as doctor_command


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")


def doctor(*words: object) -> Any:
    return CliRunner().invoke(app, ["doctor", *map(str, words)])


def own_set(root: Path) -> Path:
    return off_release(root, {"cat": (3, 2), "horse": (2, 1)})


def test_a_healthy_set_gives_two_tables_on_stdout_and_exit_code_0(tmp_path):
    result = doctor(own_set(tmp_path / "set"), "-j", 1)
    lines = result.stdout.splitlines()
    assert result.exit_code == 0
    assert lines[:4] == ["class\ttrain\ttest", "cat\t3\t2", "horse\t2\t1", "all\t5\t3"]
    assert lines[4] == "state\tcheck\tshapes\tdetail"
    assert all(line.count("\t") == 3 for line in lines[4:])
    assert "8 shapes examined" in result.stderr and "next: mvtn preprocess" in result.stderr


def test_official_counts_stand_beside_those_found(tmp_path):
    result = doctor(off_release(tmp_path / "net", {"bed": (3, 2)}), "-j", 1)
    rows = {line.split("\t")[0]: line.split("\t")[1:] for line in result.stdout.splitlines()}
    assert rows["class"] == ["train", "official", "test", "official"]
    assert rows["bed"] == ["3", "515", "2", "100"]
    assert rows["sofa"] == ["0", "680", "0", "100"] and rows["all"] == ["3", "3991", "2", "908"]
    assert result.exit_code == 1 and "this would spoil a benchmark: official counts" in result.stderr


def test_totals_stand_alone_where_classes_are_not_known(tmp_path):
    result = doctor(f"scanobjectnn:{objects_release(tmp_path / 'objects')}@hardest")
    rows = {line.split("\t")[0]: line.split("\t")[1:] for line in result.stdout.splitlines()}
    assert rows["chair"] == ["2", "", "1", ""] and rows["all"] == ["4", "11416", "2", "2882"]


def test_what_spoils_a_benchmark_exits_with_1_and_is_in_the_document(tmp_path):
    root = own_set(tmp_path / "set")
    put(root / "cat" / "test" / "leak.off", (root / "cat" / "train" / "cat_0001.off").read_text())
    put(root / "horse" / "train" / "broken.off", "OFF\n1 2\n")
    result = doctor(root, "--json", "-j", 1)
    document = json.loads(result.stdout)
    assert result.exit_code == 1
    assert json.loads(result.stderr.splitlines()[-1])["code"] == "doctor.dataset"
    assert document["schema"] == "mvtn.doctor-dataset/1" and document["ok"] is False
    states = {check["name"]: check["state"] for check in document["checks"]}
    assert {name for name, state in states.items() if state == "bad"} == {"unreadable", "duplicates across splits"}
    (group,) = document["duplicates"]
    assert group["across_splits"] and group["one_class"]
    assert [(shape["name"], shape["split"]) for shape in group["shapes"]] == [
        ("cat/leak", "test"),
        ("cat/cat_0001", "train"),
    ]
    assert [bad["name"] for bad in document["unreadable"]] == ["horse/broken"]
    assert set(document) >= {"dataset", "title", "release", "shapes", "classes", "empty", "missing", "inside_out"}
    assert set(document) >= {"up_axis", "labels", "mended", "seconds", "warnings"}
    assert "leak" in doctor(root, "-j", 1).stderr  # people are shown which


def test_jsonl_is_the_document_on_one_line(tmp_path):
    result = doctor(own_set(tmp_path / "set"), "--jsonl", "-j", 1)
    assert len(result.stdout.splitlines()) == 1 and json.loads(result.stdout)["ok"] is True


def test_made_sets_and_single_files_can_be_examined(tmp_path):
    assert doctor("builtin:shapes?train=24&test=12", "-j", 1).exit_code == 0
    assert doctor("builtin:one-sided?train=12&test=12", "-j", 1).exit_code == 0
    assert doctor(put(tmp_path / "box.off", box_off(1))).exit_code == 0


def test_a_set_that_can_t_be_opened_says_why(tmp_path):
    result = doctor(f"shapenet55:{own_set(tmp_path / 'set')}")
    assert result.exit_code == 1 and "all.csv" in result.stderr and "Traceback" not in result.stderr
    assert doctor("modelnet50:x").exit_code == 2


def test_a_bare_doctor_is_about_the_machine_whatever_the_settings_name(monkeypatch):
    monkeypatch.setattr(doctor_command, "CHECKS", ())
    monkeypatch.setenv("MVTN_DATASET", "builtin:shapes")
    Path("mvtn.toml").write_text('dataset = "builtin:shapes"\n')
    result = doctor("--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout) == {"schema": "mvtn.doctor/1", "ok": True, "warnings": [], "checks": []}


def test_the_real_points_are_whole(real_data):
    result = doctor(f"modelnet10:{real_data / 'modelnet40_points'}", "--json", "-j", 1)
    document = json.loads(result.stdout)
    assert result.exit_code == 0 and document["ok"] is True
    assert document["classes"][-1] == {
        "class": "all",
        "counts": {"train": 3991, "val": 0, "test": 908},
        "official": {"train": 3991, "test": 908},
    }
    assert all(
        row["counts"][split] == row["official"][split] for row in document["classes"] for split in row["official"]
    )
    assert document["up_axis"]["hint"] == "y" and document["duplicates"] == []
