"""From torch to ONNX and back to numbers: the extra `export`, imported where it is used."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mvtn_cli.core.export.graphs import Graph
from mvtn_cli.errors import MvtnError

PACKAGES = ("onnx", "onnxscript", "onnxruntime")
EXAMPLE_BATCH = 3  # of the inputs that the graph is drawn from; any other number may come later

Arrays = dict[str, NDArray[np.float32]]


def require() -> None:
    """Say before any work that nothing can be exported.

    Raises:
        MvtnError: A package of the extra is missing.
    """
    for name in PACKAGES:
        _import(name)


def to_onnx(graph: Graph, inputs: Mapping[str, Tensor], about: Mapping[str, str]) -> bytes:
    """Write a network as one ONNX file with its weights, the first axis of all inputs free.

    Args:
        graph: The network.
        inputs: An example of its inputs, at least two shapes.
        about: Kept in the file as its metadata.

    Raises:
        MvtnError: Some part of the network can't be written as ONNX.
    """
    require()
    batch = torch.export.Dim("batch")
    free = tuple({0: batch} for _ in graph.inputs)
    try:
        with _silent(), torch.no_grad():
            # strict, as else `len(tensor)` fixes the number of shapes; all inputs are one argument, `*given`
            given = tuple(inputs[name] for name in graph.inputs)
            traced = torch.export.export(graph.module, given, dynamic_shapes=(free,), strict=True)
            program = torch.onnx.export(
                traced,
                dynamo=True,
                input_names=list(graph.inputs),
                output_names=list(graph.outputs),
                custom_translation_table={torch.ops.aten.sort.stable: _stable_sort},
                verbose=False,
            )
    except Exception as error:  # the exporter raises many kinds, each with a page of words
        told = str(error).split("## Exception summary")[-1].split()
        raise MvtnError(
            f"{graph.name} can't be written as ONNX: {type(error).__name__}: {' '.join(told)[:300]}",
            hint="weights.safetensors holds the same network; another --backbone may be exportable",
            code="export.onnx",
        ) from error
    assert program is not None
    program.model.metadata_props.update(about)
    buffer = io.BytesIO()
    _import("onnx").save(program.model_proto, buffer)
    return buffer.getvalue()


def run_onnx(data: bytes, inputs: Mapping[str, Tensor]) -> Arrays:
    """What onnxruntime makes of inputs on the CPU; outputs by name."""
    runtime = _import("onnxruntime")
    session = runtime.InferenceSession(data, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    answers = session.run(names, {name: tensor.numpy() for name, tensor in inputs.items()})
    return dict(zip(names, answers, strict=True))


def _stable_sort(values: Any, stable: bool = True, dim: int = -1, descending: bool = False) -> Any:
    """torch's stable sort; in ONNX, TopK of all: equal values come in the order of their indices."""
    op: Any = _import("onnxscript").opset18
    count = op.Gather(op.Shape(values), op.Constant(value_ints=[dim]))
    return op.TopK(values, count, axis=dim, largest=int(descending), sorted=1)


def _import(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise MvtnError(
            f"exporting needs the package {name}, which is not installed",
            hint="pip install mvtn[export]",
            code="export.extra",
        ) from None


@contextmanager
def _silent() -> Iterator[None]:
    """Keep the exporter's words about itself from the user."""
    loggers = [logging.getLogger(name) for name in ("torch.onnx", "onnxscript", "onnx_ir")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
