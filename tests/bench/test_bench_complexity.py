"""`mvtn bench complexity`: counts against hand calculation, the stages of each network, memory that is really seen."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from torch import nn
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.console import Console
from mvtn_cli.core.bench.complexity import FORWARD, PAPER, flops_of, measure_complexity, peak_mib
from mvtn_cli.core.bench.plan import Plan, plan_for
from mvtn_cli.core.bench.subjects import builtin_subjects
from mvtn_cli.errors import UsageError

SMALL = {"image_size": 32, "num_views": 4, "repeats": 1}


def measured(*networks: str):
    plan = Plan(**SMALL, networks=networks)
    outcome = measure_complexity(builtin_subjects(1), plan, Console(quiet=True))
    return {(row["network"], row["stage"]): row for row in outcome.rows}, outcome


def test_a_multiplication_and_an_addition_are_two_operations():
    linear, convolution = nn.Linear(30, 7), nn.Conv2d(3, 5, 3, padding=1)
    assert flops_of(lambda: linear(torch.zeros(4, 30))) == 2 * 4 * 30 * 7
    assert flops_of(lambda: convolution(torch.zeros(2, 3, 8, 8))) == 2 * (2 * 8 * 8) * 5 * (3 * 3 * 3)


def test_resnet18_at_the_papers_size_has_the_quoted_operations():
    with torch.device("meta"):
        from torchvision.models import resnet18

        network = resnet18().eval()
        images = torch.empty(12, 3, 224, 224)
    assert flops_of(lambda: network(images)) / 1e9 == pytest.approx(PAPER["classifier mvcnn"].gflops, rel=0.01)


def test_every_stage_is_counted_and_the_paper_stands_beside():
    name = Plan().networks[0]
    rows, outcome = measured(name)
    assert [stage for _, stage in rows] == [*FORWARD, "backward", "step"]
    step = rows[name, "step"]
    assert rows[name, "viewpoint network"]["parameters"] == 14 * 4**2 + 303 * 4 + 3440  # the paper's formula at M = 4
    assert step["parameters"] == sum(rows[name, stage]["parameters"] for stage in FORWARD)
    assert step["gflops"] == pytest.approx(sum(rows[name, stage]["gflops"] for stage in FORWARD))
    assert rows[name, "pictures"]["gflops"] == 0 and rows[name, "viewpoint network"]["gflops"] > 0
    assert all(row["seconds"] >= 0 for row in rows.values()) and rows[name, "classifier"]["seconds"] > 0
    assert rows[name, "classifier"]["paper_parameters"] == 11.20e6
    assert outcome.notes["paper"]["classifier mvcnn"]["source"]
    assert 0 <= outcome.summary["choosing_share"] + outcome.summary["drawing_share"] < 1


def test_operations_of_the_classifier_grow_with_the_views():
    subjects, console = builtin_subjects(1), Console(quiet=True)
    found = []
    for views in (2, 4):
        plan = Plan(image_size=32, num_views=views, repeats=1, networks=("modelnet40-circular-mvcnn-12",))
        rows = {row["stage"]: row for row in measure_complexity(subjects, plan, console).rows}
        assert set(rows) == {"pictures", "classifier", "backward", "step"}  # fixed views: nothing chooses
        found.append(rows["classifier"]["gflops"])
    assert found[1] / found[0] == pytest.approx(2, rel=1e-3)


def test_a_network_of_points_has_one_stage():
    rows, _ = measured("modelnet40-pointnet")
    assert [stage for _, stage in rows] == ["classifier", "backward", "step"]


def test_a_wrong_preset_is_refused_before_anything_is_measured():
    with pytest.raises(UsageError, match="did you mean 'modelnet40-pointnet'"):
        measured("modelnet40-pointnt")


def test_the_peak_of_memory_is_that_of_the_call():
    if (before := peak_mib(lambda: None)) is None:
        pytest.skip("this system does not tell the peak of a process's memory")

    def hold() -> None:
        np.ones(64 * 2**20, np.uint8).sum()

    assert peak_mib(hold) - before > 48
    assert peak_mib(lambda: None) < before + 32  # what came before does not count


def test_the_quick_plan_says_what_it_reduces_and_the_command_can_be_repeated(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert plan_for("complexity", quick=True).repeats == 3
    words = (
        "complexity",
        "--networks",
        "modelnet40-dgcnn,modelnet40-pointnet",
        "--image-size",
        "32",
        "--num-views",
        "4",
        "--quick",
        "--json",
    )
    result = CliRunner().invoke(app, ["bench", *words])
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["command"].endswith("--num-views 4 --networks modelnet40-dgcnn,modelnet40-pointnet --seed 0")
    assert {row["network"] for row in document["rows"]} == {"modelnet40-dgcnn", "modelnet40-pointnet"}
    refused = CliRunner().invoke(app, ["bench", "render", "--networks", "modelnet40-dgcnn"])
    assert refused.exit_code == 2 and "belongs to mvtn bench complexity" in refused.stderr
