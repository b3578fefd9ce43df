"""The networks of a run as ONNX can hold them: tensors in, a few tensors out, nothing random.

Nothing is changed in the recogniser itself: what needs another form is copied first.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from mvtn_cli.core.networks.dgcnn import DGCNN, EdgeConv
from mvtn_cli.core.networks.learned import LearnedViews, RandomOffsetViews
from mvtn_cli.core.networks.points import PointClassifier
from mvtn_cli.core.networks.recogniser import Recogniser
from mvtn_cli.core.networks.regressors import light_from
from mvtn_cli.core.networks.transfer import TransferredViews
from mvtn_cli.core.networks.viewgcn import ViewGCN
from mvtn_cli.core.networks.viewpoint import Choice, ViewSelector
from mvtn_cli.core.views import camera_rotations

OUTPUTS = ("logits", "descriptor")
ANGLES = ("azimuth_deg", "elevation_deg", "distance")
STARTS = ("start_azimuth_deg", "start_elevation_deg")

NetworkT = TypeVar("NetworkT", bound=nn.Module)


@dataclass(frozen=True)
class Graph:
    """A network for export.

    Attributes:
        name: Of its file, without suffix.
        module: Takes `inputs` in their order and gives a tuple of `outputs`; on the CPU, in evaluation mode.
        original: The same as the recogniser computes it, which the exported one is held against.
        inputs: Shapes of the inputs by name, without their batch axis.
        outputs: Names.
    """

    name: str
    module: nn.Module
    original: Callable[..., tuple[Tensor, ...]]
    inputs: dict[str, tuple[int, ...]]
    outputs: tuple[str, ...]


def network_graph(model: Recogniser, num_points: int) -> Graph:
    """The classifier: pictures, directions, points, as far as it looks at them, -> logits and descriptor.

    Args:
        model: On the CPU, in evaluation mode.
        num_points: P, points that an encoder sees.
    """
    network, config = model.network, model.config
    views, size = config.num_views, config.image_size
    points: dict[str, tuple[int, ...]] = {"points": (num_points, 3)}
    if isinstance(network, PointClassifier):
        inputs = points
    else:
        inputs = {"images": (views, 3, size, size)}
        inputs |= {"directions": (views, 3)} if isinstance(network.head, ViewGCN) else {}
        inputs |= points if network.points is not None else {}
    original, module = (NetworkForExport(part, tuple(inputs)).eval() for part in (network, for_export(network)))
    return Graph("network", module, original, inputs, OUTPUTS)


def viewpoint_graph(model: Recogniser, num_points: int) -> Graph | None:
    """The viewpoint network, points -> angles and distances; None where the views are not learned.

    Views that learn from random places take these places as two further inputs.
    """
    outer = model.selector
    inner = outer.inner if isinstance(outer, TransferredViews) else outer
    if not isinstance(inner, LearnedViews) or not model.uses_views:
        return None
    inputs: dict[str, tuple[int, ...]] = {"points": (num_points, 3)}
    if isinstance(inner, RandomOffsetViews):
        inputs |= dict.fromkeys(STARTS, (outer.num_views,))
    lit = inner.scene is not None and inner.scene.light
    outputs = (*ANGLES, "light") if lit else ANGLES
    original, module = (ViewpointsForExport(part, outer.distance).eval() for part in (inner, for_export(inner)))
    return Graph("viewpoints", module, original, inputs, outputs)


class NetworkForExport(nn.Module):
    """A classifier that takes its inputs in the order of `inputs`."""

    def __init__(self, network: nn.Module, inputs: Sequence[str]) -> None:
        super().__init__()
        self.network, self.inputs = network, inputs

    def forward(self, *given: Tensor) -> tuple[Tensor, Tensor]:
        """(B, ·) each -> logits (B, C) and descriptor (B, D)."""
        values: dict[str, Tensor | None] = dict(zip(self.inputs, given, strict=True))
        if "images" in values:
            said = self.network(values["images"], values.get("directions"), values.get("points"))
        else:
            said = self.network(values["points"])
        return said.logits, said.descriptor


class ViewpointsForExport(nn.Module):
    """A viewpoint network, without exploration and without its record of saturation.

    Args:
        selector: Whose `choose` is taken; it is copied.
        distance: Of all cameras, where none is learned.
    """

    def __init__(self, selector: ViewSelector, distance: float) -> None:
        super().__init__()
        self.selector, self.distance = copy.deepcopy(selector), distance
        self.selector._tanh = torch.tanh  # type: ignore[method-assign,assignment]

    def forward(self, *given: Tensor) -> tuple[Tensor, ...]:
        """(B, P, 3), and perhaps the start (B, M) twice -> azimuths, elevations, distances, perhaps (B, M, 3)."""
        points, *start = given
        if start:
            self.selector.begin = lambda *_: start  # type: ignore[assignment]
        chosen: Choice = self.selector.choose(points, False, None)
        distance = torch.full_like(chosen.azimuth, self.distance) if chosen.distance is None else chosen.distance
        answer = chosen.azimuth, chosen.elevation, distance
        if chosen.light is None:
            return answer
        return *answer, light_from(chosen.light, camera_rotations(chosen.azimuth, chosen.elevation))


def for_export(network: NetworkT) -> NetworkT:
    """A copy whose parts are such as ONNX knows."""
    network = copy.deepcopy(network)
    for module in [module for module in network.modules() if isinstance(module, DGCNN)]:
        module.edges = nn.ModuleList(PlainEdgeConv(edge) for edge in module.edges)  # type: ignore[arg-type]
    return network


class PlainEdgeConv(nn.Module):
    """What `EdgeConv` computes in evaluation, without `embedding_bag`, which ONNX lacks, and from one table.

    Args:
        edge: Shares its weights.
    """

    def __init__(self, edge: EdgeConv) -> None:
        super().__init__()
        self.edge = edge

    def forward(self, features: Tensor) -> Tensor:
        """(B, P, inputs) -> (B, P, outputs)."""
        edge = self.edge
        near = _nearest(features, edge.neighbours)
        to_own, to_step = edge.pair.weight.chunk(2, dim=1)
        own = functional.linear(features, to_own - to_step)
        sign = torch.where(edge.norm.weight < 0, -1.0, 1.0)
        other = sign * functional.linear(features, to_step)
        wide = near.flatten(1)[..., None].expand(-1, -1, other.shape[-1])
        largest = other.gather(1, wide).unflatten(1, near.shape[1:]).amax(dim=2)
        return functional.leaky_relu(edge.norm(own + sign * largest), 0.2)


def _nearest(features: Tensor, count: int) -> Tensor:
    """As `nearest_points`, from one table of all distances, (B, P, P)."""
    centred = features - features.mean(dim=1, keepdim=True)
    half_squares = centred.square().sum(dim=-1)[:, None] / 2
    return (centred @ centred.mT - half_squares).topk(min(count, features.shape[1])).indices
