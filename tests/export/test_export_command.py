"""`mvtn export`: from a run to files that other programs read."""

from __future__ import annotations

import json
import os
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from processes import REPOSITORY, Folder
from safetensors import safe_open
from safetensors.torch import load_file
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.training.checkpoint import write_json, write_weights
from mvtn_cli.core.training.predict import load_model
from mvtn_cli.core.training.run import Run

EXAMPLES = REPOSITORY / "examples"
SMALL = ("--image-size", "16", "--num-views", "4", "--encoder-points", "32", "--epochs", "1")
CLASSES = ("bench", "chair", "one, two")


@pytest.fixture
def made(recogniser, own_folder: Path):
    """Write down a run of a recogniser that looks trained; `result` is what was measured, if anything."""

    def make(result: dict[str, Any] | None = None, **changed: Any) -> Run:
        model = recogniser(**changed)
        prepared = type("Prepared", (), {
            "classes": CLASSES, "spec": "folder:shapes", "title": "shapes", "address": "0123abcd", "known_view": False,
            "settings": type("Settings", (), {"as_dict": lambda self: {"num_points": 64}})(),
        })()  # fmt: skip
        run = Run.create(own_folder / "runs" / "made", model.config, prepared)
        write_weights(run.weights_path("best"), model.state_dict(), {})
        write_json(run.path / "best.json", {"epoch": 2, "val_accuracy": 0.5, "val_loss": 1.0})
        if result is not None:
            measured = {"split": "test", "checkpoint": "best", "count": 7, "class_accuracy": 0.25, "best": run.best}
            write_json(run.path / "result.json", {**measured, **result})
        return run

    return make


def export(*words: object):
    return CliRunner().invoke(app, ["export", *map(str, words)])


@pytest.mark.usefixtures("exporting")
def test_a_run_becomes_files_that_need_no_mvtn(made):
    import onnx

    run = made({"accuracy": 0.6543}, views="learned-spherical")
    answer = export(run.path, "--json")
    assert answer.exit_code == 0, answer.stderr
    document = json.loads(answer.stdout)
    folder = run.path / "export"
    names = ["labels.txt", "model_card.md", "network.onnx", "viewpoints.onnx", "weights.safetensors"]
    assert document["files"] == names == sorted(path.name for path in folder.iterdir())
    assert document["accuracy"] == 0.6543
    network, viewpoints = document["networks"]
    assert network["inputs"] == {"images": ["batch", 4, 3, 16, 16]} and 0 <= network["difference"] < 1e-4
    assert viewpoints["outputs"] == ["azimuth_deg", "elevation_deg", "distance"]
    for name in ("network.onnx", "viewpoints.onnx"):
        model = onnx.load(folder / name)
        onnx.checker.check_model(model, full_check=True)
        about = json.loads({pair.key: pair.value for pair in model.metadata_props}["mvtn"])
        assert about["classes"] == list(CLASSES) and about["settings"]["num_views"] == 4
    assert (folder / "labels.txt").read_text().splitlines() == list(CLASSES)
    weights = load_file(folder / "weights.safetensors")
    assert all(torch.equal(weights[name], value) for name, value in load_model(run).state_dict().items())
    with safe_open(folder / "weights.safetensors", "pt") as file:
        assert json.loads(file.metadata()["mvtn"])["run"] == "made"
    build_recogniser(run.config, 3).load_state_dict(weights)


@pytest.mark.usefixtures("exporting")
def test_the_model_card_says_what_is_known_and_no_more(made):
    run = made({"accuracy": 0.6543})
    assert export(run.path, "--out", "there").exit_code == 0
    card = Path("there/model_card.md").read_text()
    assert "| accuracy | 65.43 % |" in card and "| test shapes | 7 |" in card and "of epoch 2" in card
    assert "shapes (`folder:shapes`, stored shapes 0123abcd)" in card and "in `images` (B, 4, 3, 16, 16)" in card
    settings = tomllib.loads(card.split("```toml\n")[1].split("```")[0])
    assert settings == tomllib.loads(run.config_path.read_text())
    write_json(run.path / "best.json", {"epoch": 3, "val_accuracy": 0.6, "val_loss": 1.0})  # it learned on
    answer = export(run.path, "--out", "there")
    assert "names no accuracy" in answer.stderr
    card = Path("there/model_card.md").read_text()
    assert "65.43" not in card and "Not measured yet: `mvtn eval made --checkpoint best`" in card


def test_a_run_without_weights_or_an_unknown_one_is_a_clear_error(made, exporting):
    run = made()
    answer = export("nowhere")
    assert answer.exit_code == 2 and "unknown run 'nowhere'" in answer.stderr
    answer = export(run.path, "--checkpoint", "last")
    assert answer.exit_code == 1 and "has no last weights yet" in answer.stderr
    assert not (run.path / "export").exists()


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """A folder with a run of View-GCN on a few built-in shapes, trained for one epoch."""
    folder = Folder(tmp_path_factory.mktemp("trained") / "work")
    train = ["train", "builtin:shapes?train=24&test=8", "--network", "viewgcn", "--views", "learned-spherical"]
    ended = folder.run("mvtn", *train, *SMALL, "--name", "run", "-q", "-j", "1", "--threads", "1")
    assert ended.code == 0, ended.err
    return folder


@pytest.mark.usefixtures("exporting")
def test_an_example_classifies_files_as_predict_does(trained: Folder, tmp_path: Path):
    assert export(trained.path / "runs" / "run", "-q").exit_code == 0
    corners = [(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)]
    sides = ["4 0 1 3 2", "4 4 6 7 5", "4 0 4 5 1", "4 2 3 7 6", "4 0 2 6 4", "4 1 5 7 3"]
    for name, tall in (("flat.off", 1), ("tall.off", 5)):
        lines = ["OFF", "8 6 0", *(f"{x} {tall * y} {z}" for x, y, z in corners), *sides]
        (trained.path / name).write_text("\n".join(lines))
    (tmp_path / "mvtn").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m mvtn_cli "$@"\n')
    (tmp_path / "mvtn").chmod(0o755)
    path = os.pathsep.join([str(tmp_path), os.environ["PATH"]])
    ended = trained.run(
        "python", EXAMPLES / "classify_with_onnx.py", "runs/run", "flat.off", "tall.off", variables={"PATH": path}
    )
    assert ended.code == 0, ended.err
    said = trained.run("mvtn", "predict", "flat.off", "tall.off", "--run", "run", "--json", "-q", "-j", "1")
    for line, right in zip(ended.out.splitlines(), said.document["predictions"], strict=True):
        file, name, probability = line.split("\t")
        assert (Path(file).name, name) == (Path(right["file"]).name, right["class"])
        assert np.isclose(float(probability), right["probability"], atol=5e-3)  # pictures came in 256 steps


def test_ten_lines_of_python_classify_and_give_a_gradient(trained: Folder):
    ended = trained.run("python", EXAMPLES / "ten_lines.py")
    assert ended.code == 0, ended.err
    share, shapes = re.search(r"^([\d.]+)% of (\d+) test shapes; \S+: \S+$", ended.out, re.M).groups()
    assert shapes == "8" and abs(float(share) / 12.5 - round(float(share) / 12.5)) < 0.01  # of eight
    slopes = [float(slope) for slope in re.findall(r"([+-][\d.]+) a degree", ended.out)]
    assert len(slopes) == 3 and all(np.isfinite(slopes)) and any(slopes)


def test_the_ten_lines_of_the_manual_are_those_of_the_example():
    manual = (REPOSITORY / "docs" / "library.md").read_text(encoding="utf-8")
    example = (EXAMPLES / "ten_lines.py").read_text(encoding="utf-8")
    lines = [line.split("  #")[0].rstrip() for line in manual.split("```python\n")[1].split("```")[0].splitlines()]
    assert len([line for line in lines if line]) == 10
    assert [line for line in lines if line not in example and not line.startswith("run = ")] == []
