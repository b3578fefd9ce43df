"""A run as files that other programs read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch

from mvtn_cli import __version__
from mvtn_cli.console import Console
from mvtn_cli.core.export.card import measured, model_card
from mvtn_cli.core.export.checking import check, random_inputs
from mvtn_cli.core.export.graphs import Graph, network_graph, viewpoint_graph
from mvtn_cli.core.export.onnx_files import EXAMPLE_BATCH, require, to_onnx
from mvtn_cli.core.networks.recogniser import Recogniser
from mvtn_cli.core.training.checkpoint import write_run_file, write_weights
from mvtn_cli.core.training.predict import load_model
from mvtn_cli.core.training.run import Run
from mvtn_cli.export_config import ExportConfig

SCHEMA = "mvtn.export/1"


def export_run(run: Run, config: ExportConfig, console: Console) -> dict[str, Any]:
    """Write a run's networks as ONNX, its weights, its classes and a model card.

    Into `config.out`, else RUN/export: `network.onnx`, `viewpoints.onnx` where views are learned, `labels.txt`,
    `weights.safetensors` and `model_card.md`. They are written when all networks have been checked.

    Args:
        run: It has weights.
        config: Checkpoint, out, and seed of the check.
        console: For progress.

    Returns:
        A document: `schema`, `run`, `checkpoint`, `folder`, `files`, `accuracy` (None where not measured), and
        `networks`, one dictionary each: `file`, `inputs`, `outputs` and `difference`.

    Raises:
        MvtnError: The extra is not installed, the run has no weights, a network can't be written as ONNX, or
            says something else there.
    """
    require()
    model = load_model(run, config.checkpoint, "cpu")
    graphs = graphs_of(run, model)
    files: dict[str, bytes] = {}
    differences: dict[str, float] = {}
    for graph in graphs:
        console.note(f"{graph.name}.onnx …")
        example = random_inputs(graph, EXAMPLE_BATCH, torch.Generator().manual_seed(config.seed))
        data = to_onnx(graph, example, _metadata(run, config.checkpoint))
        differences[graph.name] = check(graph, data, config.seed)
        files[f"{graph.name}.onnx"] = data

    files["labels.txt"] = "".join(f"{name}\n" for name in run.classes).encode()
    files["model_card.md"] = model_card(run, model, config.checkpoint, graphs, differences).encode()
    folder = Path(config.out or run.path / "export")
    for stale in ("network.onnx", "viewpoints.onnx"):
        (folder / stale).unlink(missing_ok=True)
    write_weights(folder / "weights.safetensors", model.state_dict(), _about(run, config.checkpoint))
    for name, data in files.items():
        write_run_file(folder / name, data)
    result = measured(run, config.checkpoint)
    return {
        "schema": SCHEMA,
        "run": str(run.path),
        "checkpoint": config.checkpoint,
        "folder": str(folder),
        "files": sorted([*files, "weights.safetensors"]),
        "accuracy": result["accuracy"] if result else None,
        "networks": [_facts(graph, differences[graph.name]) for graph in graphs],
    }


def graphs_of(run: Run, model: Recogniser) -> list[Graph]:
    """The networks of a run that can be exported: the classifier, and the viewpoint network if there is one."""
    points = min(run.config.encoder_points, int(run.info["preprocess"]["num_points"]))
    graphs = [network_graph(model, points), viewpoint_graph(model, points)]
    return [graph for graph in graphs if graph is not None]


def _facts(graph: Graph, difference: float) -> dict[str, Any]:
    return {
        "file": f"{graph.name}.onnx",
        "inputs": {name: ["batch", *shape] for name, shape in graph.inputs.items()},
        "outputs": list(graph.outputs),
        "difference": difference,
    }


def _metadata(run: Run, checkpoint: str) -> dict[str, str]:
    return {"mvtn": json.dumps(_about(run, checkpoint))}


def _about(run: Run, checkpoint: str) -> dict[str, Any]:
    config = run.config
    return {
        "version": __version__,
        "run": run.name,
        "checkpoint": checkpoint,
        "classes": list(run.classes),
        "settings": config.model_dump(mode="json", exclude_none=True, exclude={"runs", "cache"}),
    }
