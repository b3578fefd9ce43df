"""Whatever is wrong, one sentence says what, a second what to do, and the exit code whose fault it is."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from demonstration import Demo
from processes import Folder


def damaged(folder: Folder, demo: Demo, file: str) -> Path:
    """Copy the demo's run, as if it had been interrupted, with a file cut off in its middle."""
    run = folder.path / "runs" / "damaged"
    shutil.copytree(demo.run, run)
    info = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({**info, "state": "interrupted"}))
    content = (run / file).read_bytes()
    (run / file).write_bytes(content[: len(content) // 2])
    return run


@pytest.mark.parametrize("command", ["preprocess", "train"])
def test_a_misspelt_folder_is_answered_with_the_nearest_one(command: str, folder: Folder):
    (folder.path / "my meshes").mkdir()
    result = folder.mvtn(command, "my mehses")
    message, hint = result.error
    assert result.code == 1 and result.out == ""
    assert message == "no such file or folder: my mehses" and hint == f"did you mean {folder.path}/my meshes?"


def test_a_folder_without_shapes_is_told_what_was_looked_for(folder: Folder):
    (folder.path / "nür Text").mkdir()
    (folder.path / "nür Text" / "read me.md").write_text("")
    result = folder.mvtn("preprocess", "nür Text")
    message, hint = result.error
    assert result.code == 1 and message.startswith("no readable shape in nür Text: looked for *.glb ")
    assert hint.startswith("1 match '*.md'; readable are ")


def test_eval_before_any_training_says_how_to_train(folder: Folder):
    result = folder.mvtn("eval")
    assert (result.code, result.error) == (1, ("no trained run in runs", "train one first: mvtn train"))


def test_learned_views_without_gradient_are_refused(folder: Folder):
    result = folder.mvtn("train", "--views", "learned", "--gradient", "none")
    message, hint = result.error
    assert result.code == 2 and message == "with --gradient none the pictures can't teach learned-spherical views"
    assert "--allow-no-gradient" in hint and not (folder.path / "runs").exists()


@pytest.mark.parametrize(
    ("words", "option"),
    [(["preprocess", "--cache", "taken"], "--cache"), (["train", "--runs", "taken"], "--runs")],
)
def test_a_file_in_place_of_a_folder_is_named_with_the_way_out(words: list[str], option: str, folder: Folder):
    (folder.path / "taken").write_text("")
    result = folder.mvtn(*words)
    message, hint = result.error
    assert result.code == 1 and "/taken/" in f"/{message}" and message.endswith("Not a directory")
    assert option in hint


@pytest.mark.parametrize(
    ("file", "words"), [("run.json", ["eval"]), ("best.safetensors", ["eval"]), ("state.pt", ["train"])]
)
def test_a_run_with_half_a_file_is_not_used_and_the_file_is_named(
    file: str, words: list[str], folder: Folder, demo: Demo
):
    damaged(folder, demo, file)
    result = folder.mvtn(*words)
    message, hint = result.error
    assert result.code == 1 and message.startswith("can't read ") and f"runs/damaged/{file}" in message
    assert hint


def test_half_a_file_of_the_last_weights_is_made_whole_by_going_on(folder: Folder, demo: Demo):
    run = damaged(folder, demo, "last.safetensors")
    result = folder.mvtn("train")  # the state has all weights once more
    assert result.code == 0 and f"going on with the unfinished run {run.relative_to(folder.path)}" in result.err


def test_a_run_is_not_measured_on_other_classes_than_it_knows(folder: Folder, demo: Demo):
    run = folder.path / "runs" / "other"
    shutil.copytree(demo.run, run)
    (run / "run.json").write_text((run / "run.json").read_text().replace('"mug"', '"cup"'))
    result = folder.mvtn("eval", "other")
    message, hint = result.error
    assert result.code == 2 and message.startswith("run other knows the classes ")
    assert "mvtn train" in hint and "mvtn predict" in hint
