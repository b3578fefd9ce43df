"""`mvtn retrieve`: from a run to figures, lists and pictures."""

from __future__ import annotations

import csv
import json
import os
import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from demonstration import Demo
from PIL import Image
from processes import Ended
from typer.testing import CliRunner

from mvtn_cli.app import app

Retrieve = Callable[..., Ended]


@pytest.fixture
def retrieve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, demo: Demo) -> Retrieve:
    """Run `mvtn retrieve RUN WORDS...` in this process, with a copy of the demo's run and store."""
    shutil.copytree(demo.run, tmp_path / "work" / "runs" / "tiny")
    shutil.copytree(demo.folder.cache, tmp_path / "store")
    monkeypatch.chdir(tmp_path / "work")
    for name in [name for name in os.environ if name.startswith("MVTN_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("MVTN_CACHE", str(tmp_path / "store"))

    def run(*words: object, stdin: bytes = b"") -> Ended:
        result = CliRunner().invoke(app, ["retrieve", *map(str, words), "-j", "1", "--threads", "1"], input=stdin)
        return Ended(result.exit_code, result.stdout, result.stderr)

    return run


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def write_box(path: Path) -> Path:
    """A box, as OFF."""
    corners = [(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)]
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    lines = ["OFF", "8 6 0", *(f"{x} {y} {z}" for x, y, z in corners), *("4 " + " ".join(map(str, s)) for s in sides)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_bare_call_measures_the_latest_run_and_the_second_time_describes_nothing(retrieve: Retrieve):
    first = retrieve("--json")
    assert first.code == 0, first.err
    found, folder = first.document, Path("runs/tiny/retrieval")
    assert (found["schema"], found["protocol"], found["queries"]) == ("mvtn.retrieve/1", "paper", 12)
    assert found["gallery"] == {"split": "train", "count": 24} and found["described"] == 36
    assert found["lfda"]["fitted_on"] == 24 and 0 < found["micro"]["ap"] <= 1
    assert json.loads((folder / "result.json").read_text())["micro"] == found["micro"]
    classes, queries = rows(folder / "per_class.csv"), rows(folder / "queries.csv")
    mean = sum(float(row["ap"]) for row in queries) / 12
    assert mean == pytest.approx(found["micro"]["ap"], abs=1e-5)
    assert sum(float(row["ap"]) for row in classes) / len(classes) == pytest.approx(found["macro"]["ap"], abs=1e-5)
    curves = rows(folder / "precision_recall.csv")
    assert len(curves) == 21 and list(curves[0])[:3] == ["recall", "micro", "macro"]
    assert [float(row["micro"]) for row in curves] == pytest.approx(found["precision_recall"]["micro"], abs=1e-5)
    assert all(float(a["micro"]) >= float(b["micro"]) for a, b in pairwise(curves))
    assert "recall" in (folder / "precision_recall.svg").read_text()
    with Image.open(folder / "precision_recall.png") as image:
        assert image.width > 700
    with Image.open(folder / "figure.png") as image:
        assert image.width > 11 * 112 and image.height > 5 * 112
    again = retrieve("--json", "--figure", "0")
    assert again.document["described"] == 0 and again.document["micro"] == found["micro"]
    assert not (folder / "figure.png").exists()


def test_what_is_asked_for_changes_what_is_computed(retrieve: Retrieve):
    plain = retrieve("--json", "--no-lfda", "--at", "1,5", "--figure", "0").document
    assert plain["lfda"] is None and list(plain["micro"])[3:] == ["p@1", "r@1", "f1@1", "p@5", "r@5", "f1@5"]
    cosine = retrieve("--json", "--no-lfda", "--metric", "cosine", "--figure", "0", "--limit", 6).document
    assert cosine["queries"] == 6 and cosine["described"] == 6
    few = retrieve("--json", "--lfda-dim", 3, "--gallery-limit", 12, "--figure", "0", "-o", "here").document
    assert few["lfda"] == {"dim": 3, "fitted_on": 12} and Path("here/result.json").is_file()
    table = retrieve("--figure", "0").out.splitlines()
    assert table[0].split("\t") == ["measure", "micro %", "macro %"] and table[1].startswith("mAP\t")


def test_other_weights_have_other_descriptors(retrieve: Retrieve):
    best = retrieve("--json", "--figure", "0").document
    shutil.copy("runs/tiny/best.safetensors", "runs/tiny/last.safetensors")
    same = retrieve("--json", "--figure", "0", "--checkpoint", "last").document
    assert best["described"] == 36 and same["described"] == 0  # the address is made of the weights, not of their name
    weights = Path("runs/tiny/best.safetensors")
    content = bytearray(weights.read_bytes())
    content[-3] ^= 1
    weights.write_bytes(content)
    assert retrieve("--json", "--figure", "0").document["described"] == 36


def test_shrec17_writes_official_files_that_score_the_same(retrieve: Retrieve):
    from mvtn_cli.core.retrieval.shrec17 import read_lists, read_truth, score_lists

    done = retrieve("--protocol", "shrec17", "-o", "sent", "--json")
    assert done.code == 0, done.err
    lists, truth = read_lists(Path("sent/test_normal")), read_truth(Path("sent/all.csv"), "test")
    assert sorted(lists) == sorted(truth.ids) == [f"{n:06d}" for n in range(12)]
    assert all(entries[0] == (query, 0.0) and len(entries) == 12 for query, entries in lists.items())
    scored = score_lists(truth, lists)
    assert scored["micro"] == pytest.approx(done.document["micro"])
    assert scored["macro"] == pytest.approx(done.document["macro"])
    assert done.document["micro"]["R@N"] == 1
    official = rows(Path("sent/tiny.summary.csv"))
    assert list(official[0]) == ["class", "P@N", "R@N", "F1@N", "mAP", "NDCG", "dataset", "method"]
    assert [row["class"] for row in official[-2:]] == ["microALL", "macroALL"]
    assert float(official[-2]["mAP"]) == pytest.approx(scored["micro"]["mAP"], abs=1e-5)
    assert {(row["dataset"], row["method"]) for row in official} == {("test_normal", "tiny")}
    assert len(rows(Path("sent/per_class.csv"))) == len(official) - 2
    assert [float(row["macro"]) for row in rows(Path("sent/tiny.pr.csv"))] == pytest.approx(
        scored["precision_recall"]["macro"], abs=1e-5
    )
    narrow = retrieve("--protocol", "shrec17", "--lists", "same-class", "--figure", 0, "--json").document
    assert narrow["micro"]["P@N"] > done.document["micro"]["P@N"]
    assert not Path("runs/tiny/retrieval-shrec17/test_normal").exists()


def test_a_file_finds_its_like_and_gets_a_picture(retrieve: Retrieve):
    write_box(Path("table/box.off"))
    write_box(Path("elsewhere/box.off"))
    done = retrieve("--query", "table/box.off", "--query", "elsewhere/box.off", "--top", 3, "-o", "seen")
    assert done.code == 0, done.err
    lines = [line.split("\t") for line in done.out.splitlines()]
    assert [line[:2] for line in lines] == [
        [f"{folder}/box.off", str(rank)] for folder in ("table", "elsewhere") for rank in (1, 2, 3)
    ]
    assert [line[2:] for line in lines[:3]] == [line[2:] for line in lines[3:]]
    assert float(lines[0][3]) <= float(lines[1][3]) <= float(lines[2][3])
    assert sorted(path.name for path in Path("seen").iterdir()) == ["elsewhere-box.png", "table-box.png"]
    piped = retrieve("--query", "-", "--top", 2, "--json", "-o", "seen", stdin=b"table/box.off\n").document
    (answer,) = piped["queries"]
    assert answer["class"] == "table" and [hit["rank"] for hit in answer["hits"]] == [1, 2] and piped["bad"] == 0
    assert answer["hits"][0]["name"] == lines[0][4]


def test_bad_files_are_named_and_the_others_answered(retrieve: Retrieve):
    write_box(Path("box.off"))
    Path("broken.off").write_text("OFF\n")
    done = retrieve("--query", "box.off", "--query", "broken.off", "--query", "gone.off", "--jsonl", "--top", 1)
    assert done.code == 1 and [line["query"] for line in done.lines] == ["box.off"]
    assert "warning: broken.off: " in done.err and "warning: gone.off: no such file" in done.err
    message, _ = retrieve("--query", "gone.off").error
    assert message == "1 of 1 files can't be used"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nosuch"], "unknown run 'nosuch'"),
        (["tiny", "--checkpoint", "last"], "run tiny has no last weights yet"),
        (["--query", "box.off", "--top", "0"], "--top must be at least 1, got 0"),
        (["--at", "0"], "--at must be at least 1, got 0"),
        (["--protocol", "shrec17", "--query", "x.off"], "--query finds shapes for a file"),
        (["--runs", "empty"], "no trained run in empty"),
        (["--protocol", "shrec17", "--split", "val"], "no labelled shapes for split 'val' in builtin:shapes"),
    ],
)
def test_wrong_wishes_are_one_sentence(words: list[Any], told: str, retrieve: Retrieve):
    Path("runs/tiny/last.safetensors").unlink()
    write_box(Path("box.off"))
    runs = [] if told.startswith("no trained") else ["tiny"] if words[0].startswith("--") else []
    ended = retrieve(*runs, *words)
    assert ended.code in (1, 2) and told in ended.error[0]


def test_a_data_set_with_other_classes_is_refused(retrieve: Retrieve):
    path = Path("runs/tiny/run.json")
    info = json.loads(path.read_text())
    path.write_text(json.dumps({**info, "classes": [*info["classes"][:-1], "spaceship"]}))
    message, hint = retrieve("tiny").error
    assert "knows the classes" in message and "mvtn train" in hint
