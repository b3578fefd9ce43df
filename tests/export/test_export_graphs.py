"""What is exported computes what the recogniser computes, before ONNX comes into it and after."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional

from mvtn_cli.core.export import checking
from mvtn_cli.core.export.checking import TOLERANCE, check, random_inputs
from mvtn_cli.core.export.graphs import network_graph, viewpoint_graph
from mvtn_cli.core.export.onnx_files import EXAMPLE_BATCH, require, run_onnx, to_onnx
from mvtn_cli.errors import MvtnError

POINTS = 24
NETWORKS = {
    "mvcnn": {},
    "rotationnet": {"network": "rotationnet", "layout": "circular"},
    "viewgcn": {"network": "viewgcn", "num_views": 8, "fuse": True, "graph_width": 8},
    "dgcnn": {"network": "dgcnn"},
}
SELECTIONS = {
    "direct": {"views": "learned-direct"},
    "random, all learned": {
        "views": "learned-random", "encoder": "pointnet", "tnets": True, "learn_distance": 1.5, "learn_light": True,
    },
}  # fmt: skip


def example(graph, batch: int = EXAMPLE_BATCH, seed: int = 7):
    return random_inputs(graph, batch, torch.Generator().manual_seed(seed))


def onnx_of(graph) -> bytes:
    return to_onnx(graph, example(graph), {"mvtn": json.dumps({"classes": ["a", "b", "c"]})})


@pytest.mark.usefixtures("exporting")
@pytest.mark.parametrize("changed", NETWORKS.values(), ids=NETWORKS)
def test_a_classifier_says_the_same_in_onnx_for_any_number_of_shapes(changed, recogniser):
    model = recogniser(**changed)
    graph = network_graph(model, POINTS)
    data = onnx_of(graph)
    for batch in (1, 2, 6):
        inputs = example(graph, batch, seed=batch)
        with torch.no_grad():
            given = [inputs.get(name) for name in ("images", "directions", "points")]
            said = model.network(*given) if model.uses_views else model.network(inputs["points"])
        found = run_onnx(data, inputs)
        assert found["logits"].shape == (batch, 3)
        for name, right in (("logits", said.logits), ("descriptor", said.descriptor)):
            assert np.allclose(found[name], right, rtol=TOLERANCE, atol=TOLERANCE), name


@pytest.mark.usefixtures("exporting")
@pytest.mark.parametrize("changed", SELECTIONS.values(), ids=SELECTIONS)
def test_a_viewpoint_network_says_the_same_in_onnx(changed, recogniser):
    model = recogniser(**changed)
    graph = viewpoint_graph(model, POINTS)
    inputs = example(graph, 5, seed=1)
    found = run_onnx(onnx_of(graph), inputs)
    if "start_azimuth_deg" in inputs:
        model.selector.begin = lambda *_: (inputs["start_azimuth_deg"], inputs["start_elevation_deg"])
    with torch.no_grad():
        cameras, light = model.selector.place(inputs["points"])
    for name in ("azimuth_deg", "elevation_deg", "distance"):
        assert np.allclose(found[name], getattr(cameras, name), atol=1e-2 * TOLERANCE * 360), name
    assert ("light" in found) == (light is not None)
    if light is not None:
        assert np.allclose(found["light"], light, atol=TOLERANCE)


@pytest.mark.parametrize("changed", [*NETWORKS.values(), {"network": "pointnet", "tnets": True}])
def test_the_forms_made_for_export_change_no_answer(changed, recogniser):
    graph = network_graph(recogniser(**changed), POINTS)
    inputs = example(graph).values()
    for one, other in zip(graph.module(*inputs), graph.original(*inputs), strict=True):
        assert torch.allclose(one, other, atol=1e-5)


def test_only_what_a_network_looks_at_is_asked_for(recogniser):
    asked = {name: list(network_graph(recogniser(**changed), POINTS).inputs) for name, changed in NETWORKS.items()}
    assert asked == {
        "mvcnn": ["images"],
        "rotationnet": ["images"],
        "viewgcn": ["images", "directions", "points"],
        "dgcnn": ["points"],
    }
    assert viewpoint_graph(recogniser(views="jittered"), POINTS) is None


def test_making_a_graph_leaves_the_recogniser_as_it_is(recogniser):
    model = recogniser(views="learned-random", encoder="dgcnn")
    before = {name: value.clone() for name, value in model.state_dict().items()}
    modules = [type(module) for module in model.modules()]
    points = functional.normalize(torch.randn(2, POINTS, 3), dim=-1)
    placed = model.selector(points).azimuth_deg
    graph = viewpoint_graph(model, POINTS)
    graph.module(*example(graph).values())
    assert [type(module) for module in model.modules()] == modules
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())
    assert torch.equal(model.selector(points).azimuth_deg, placed) and not np.isnan(model.selector.saturation())


@pytest.mark.parametrize(("added", "told"), [(0.25, r"0\.2\d*"), (float("nan"), "inf")])
def test_a_network_that_came_out_otherwise_is_refused_with_the_difference(added, told, recogniser, monkeypatch):
    graph = network_graph(recogniser(), POINTS)

    @torch.no_grad()
    def run(data, inputs, error=added):
        logits, descriptor = graph.original(*inputs.values())
        return {"logits": logits.numpy(), "descriptor": (descriptor + error).numpy()}

    monkeypatch.setattr(checking, "run_onnx", partial(run, error=TOLERANCE / 2))
    assert 0.4 * TOLERANCE < check(graph, b"", seed=0) < TOLERANCE
    monkeypatch.setattr(checking, "run_onnx", run)
    with pytest.raises(MvtnError, match=f"network.onnx differs .* by up to {told}, more than") as refused:
        check(graph, b"", seed=0)
    assert refused.value.code == "export.differs"


@pytest.mark.usefixtures("exporting")
def test_a_layer_that_onnx_lacks_is_one_sentence(recogniser):
    graph = network_graph(recogniser(), POINTS)

    class Odd(nn.Module):
        def forward(self, *given):
            picture = given[0].mean(dim=(1, 2, 3, 4))
            return torch.special.bessel_j0(picture), picture

    with pytest.raises(MvtnError, match="network can't be written as ONNX") as refused:
        onnx_of(replace(graph, module=Odd()))
    assert "\n" not in refused.value.message and refused.value.hint


def test_without_the_extra_the_line_to_install_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(MvtnError, match="needs the package onnx") as refused:
        require()
    assert refused.value.hint == "pip install mvtn[export]"
