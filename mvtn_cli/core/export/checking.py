"""Whether an exported network says what the network itself says."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional

from mvtn_cli.core.export.graphs import Graph
from mvtn_cli.core.export.onnx_files import EXAMPLE_BATCH, run_onnx
from mvtn_cli.errors import MvtnError

TOLERANCE = 1e-4
BATCHES = (1, EXAMPLE_BATCH + 2)  # none of them the one that the graph was drawn from


def random_inputs(graph: Graph, batch: int, generator: torch.Generator) -> dict[str, Tensor]:
    """Inputs of the kind that the network gets: pictures in [0, 1], unit vectors, points in the unit ball, degrees.

    Args:
        graph: Says their shapes.
        batch: B.
        generator: Where they come from.
    """
    return {name: _random(name, (batch, *shape), generator) for name, shape in graph.inputs.items()}


def largest_difference(graph: Graph, data: bytes, seed: int) -> float:
    """Hold an exported network against the original, on random shapes, one alone and several at once.

    Args:
        graph: The original.
        data: The exported one, as ONNX.
        seed: Of the inputs.

    Returns:
        The largest difference of any number from what torch says, as a share of the largest number of its output
        where that is above 1; infinite if something is not finite.
    """
    generator = torch.Generator().manual_seed(seed)
    return max(_difference(graph, data, random_inputs(graph, batch, generator)) for batch in BATCHES)


def check(graph: Graph, data: bytes, seed: int) -> float:
    """The same, refusing a network that differs by more than `TOLERANCE`.

    Raises:
        MvtnError: It does.
    """
    difference = largest_difference(graph, data, seed)
    if not difference <= TOLERANCE:
        raise MvtnError(
            f"{graph.name}.onnx differs from the network by up to {difference:.2g}, more than {TOLERANCE:g}: "
            "nothing was written",
            hint="a choice of neighbours may have been nearly tied for these random shapes: try --seed 1",
            code="export.differs",
        )
    return difference


def _difference(graph: Graph, data: bytes, inputs: Mapping[str, Tensor]) -> float:
    with torch.no_grad():
        wanted = graph.original(*inputs.values())
    found = run_onnx(data, inputs)
    worst = 0.0
    for name, right in zip(graph.outputs, wanted, strict=True):
        apart = (torch.from_numpy(found[name]) - right).abs().max() / right.abs().max().clamp_min(1.0)
        worst = max(worst, float(apart) if torch.isfinite(apart) else float("inf"))
    return worst


def _random(name: str, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
    if name == "images":
        return torch.rand(shape, generator=generator)
    if name.endswith("_deg"):
        reach = 90.0 if "elevation" in name else 180.0
        return reach * (2 * torch.rand(shape, generator=generator) - 1)
    directions = functional.normalize(torch.randn(shape, generator=generator), dim=-1)
    if name == "directions":
        return directions
    return directions * torch.rand((*shape[:2], 1), generator=generator) ** (1 / 3)
