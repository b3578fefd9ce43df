"""View-GCN: the views as nodes of a graph on the sphere, thinned out from level to level."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from mvtn_cli.core.networks.heads import Answer, HeadOutput, MultiViewHead, cross_entropy_of_rows
from mvtn_cli.core.networks.layers import leaky, norm_layers
from mvtn_cli.core.networks.view_graph import canonical_order, farthest_views, nearest_views, pick
from mvtn_cli.errors import UsageError

NEIGHBOURS = 4
FEWEST_VIEWS = 4
WIDEST = 512  # of the graph, where no width is asked for


class ViewGCN(MultiViewHead):
    """Three levels of M, max(4, M // 2) and max(4, M // 4) views, each pooled; the three together are classified.

    A level exchanges features between near views (`LocalGCN`), is pooled, exchanges them between all views
    (`NonLocal`) and keeps the most telling views (`ViewSampler`), whose classifiers are trained along. The graph
    is made from the actual directions of each shape's cameras, through which it also has a gradient; their
    distances play no part, and neither does the numbering of the views.

    Args:
        dimension: D, of the features.
        classes: Number of classes C.
        num_views: M, at least 4; the samplers' weights are made for it.
        width: Of the graph's features; None is D, but at most 512. Features of another width go through a
            linear layer first.

    Raises:
        UsageError: Fewer than 4 views.

    References:
        Wei, Yu, Sun. View-GCN: View-based Graph Convolutional Network for 3D Shape Analysis. CVPR 2020.
    """

    def __init__(self, dimension: int, classes: int, num_views: int, *, width: int | None = None) -> None:
        super().__init__()
        if num_views < FEWEST_VIEWS:
            raise UsageError(
                f"View-GCN needs at least {FEWEST_VIEWS} views, not {num_views}",
                hint=f"--num-views {FEWEST_VIEWS} or more, or --network mvcnn",
                code="network.too-few-views",
            )
        width = width or min(dimension, WIDEST)
        counts = [max(FEWEST_VIEWS, num_views // 2), max(FEWEST_VIEWS, num_views // 4)]
        self.narrow = nn.Identity() if width == dimension else nn.Linear(dimension, width)
        self.local = nn.ModuleList(LocalGCN(width) for _ in range(3))
        self.non_local = nn.ModuleList(NonLocal(width) for _ in range(2))
        self.samplers = nn.ModuleList(ViewSampler(width, classes, count) for count in counts)
        self.classifier = nn.Sequential(
            nn.Linear(3 * width, width), leaky(), nn.Linear(width, width), nn.Dropout(0.5), leaky(),
            nn.Linear(width, classes),
        )  # fmt: skip
        for layer in self.modules():
            if isinstance(layer, nn.Linear):
                nn.init.kaiming_uniform_(layer.weight)

    def forward(self, features: Tensor, directions: Tensor) -> HeadOutput:
        """(B, M, D) and (B, M, 3) -> logits (B, C), descriptor (B, 3 · width), the samplers' logits (B, S, C)."""
        order = canonical_order(directions)
        features, directions = self.narrow(pick(features, order)), pick(directions, order)
        pooled, sampled = [], []
        for level, local in enumerate(self.local):
            features = local(features, directions)
            pooled.append(features.amax(dim=1))
            if level < len(self.samplers):
                features, directions, logits = self.samplers[level](self.non_local[level](features), directions)
                sampled.append(logits.flatten(1, 2))
        descriptor = torch.cat(pooled, dim=1)
        return HeadOutput(self.classifier(descriptor), descriptor, {"samplers": torch.cat(sampled, dim=1)})

    def losses(self, output: Answer, labels: Tensor, label_smoothing: float = 0.0) -> dict[str, Tensor]:
        samplers = cross_entropy_of_rows(output.extra["samplers"], labels, label_smoothing)
        return {**super().losses(output, labels, label_smoothing), "samplers": samplers}


class LocalGCN(nn.Module):
    """Each view's feature becomes a weighted sum of those of its 4 nearest views, then passes one layer.

    The weight of an edge comes from a small network that sees where its two views are.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.edge = nn.Sequential(nn.Linear(10, 10), leaky(), nn.Linear(10, 10), leaky(), nn.Linear(10, 1))
        self.layer = nn.Sequential(*norm_layers(width, width, leaky))

    def forward(self, features: Tensor, directions: Tensor) -> Tensor:
        """(B, N, W) and (B, N, 3) -> (B, N, W)."""
        views = torch.arange(features.shape[1], device=features.device).expand(features.shape[:2])
        near = nearest_views(directions, views, NEIGHBOURS)
        there = pick(directions, near)
        here = directions[:, :, None].expand_as(there)
        apart = here - there
        length = torch.linalg.vector_norm(apart, dim=-1, keepdim=True)
        weight = self.edge(torch.cat([here, there, apart, length], dim=-1))
        return self.layer((weight * pick(features, near)).sum(dim=2))


class NonLocal(nn.Module):
    """Each view gets a message from every view, itself included: the sum of what three layers make of the pair."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.pair = nn.Linear(2 * width, width)
        self.relation = nn.Sequential(leaky(), nn.Linear(width, width), leaky(), nn.Linear(width, width), leaky())
        self.fusion = nn.Sequential(*norm_layers(2 * width, width, leaky))

    def forward(self, features: Tensor) -> Tensor:
        """(B, N, W) -> (B, N, W)."""
        # the layer on each pair, put together from its halves on each view: N products instead of N²
        to_own, to_other = self.pair.weight.chunk(2, dim=1)
        own = functional.linear(features, to_own, self.pair.bias)
        other = functional.linear(features, to_other)
        messages = self.relation(own[:, :, None] + other[:, None]).sum(dim=2)
        return self.fusion(torch.cat([features, messages], dim=-1))


class ViewSampler(nn.Module):
    """Keep S of N views: S spread-out ones, each replaced by that of its 4 nearest which is surest of its class.

    The classifier sees the views of one rank (nearest, second nearest, …) of all groups at once. The choice has
    no gradient; the classifier is trained by its own term of the loss.
    """

    def __init__(self, width: int, classes: int, count: int) -> None:
        super().__init__()
        self.count = count
        self.classifier = nn.Sequential(
            nn.Linear(count * width, count * width // 2), leaky(), nn.Linear(count * width // 2, count * classes)
        )

    def forward(self, features: Tensor, directions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """(B, N, W), (B, N, 3) -> the views kept, (B, S, W) and (B, S, 3), and logits (B, S, 4, C)."""
        batch, views = features.shape[:2]
        first = torch.zeros(batch, dtype=torch.int64)
        if self.training:
            first = torch.randint(views, (batch,))
        centres = farthest_views(directions, self.count, first.to(features.device))
        groups = nearest_views(directions, centres, NEIGHBOURS)
        by_rank = pick(features, groups).transpose(1, 2).flatten(2)
        logits = self.classifier(by_rank).unflatten(-1, (self.count, -1)).transpose(1, 2)
        kept = groups.gather(2, doubt(logits).argmin(dim=-1, keepdim=True))[..., 0]
        return pick(features, kept), pick(directions, kept), logits


@torch.no_grad()
def doubt(logits: Tensor) -> Tensor:
    """How unsure each row (..., C) is of its class, (...): log((1 - p) / p) of the largest probability p.

    Rows have the order of their largest probability, also where that rounds to 1.
    """
    best, which = logits.max(dim=-1, keepdim=True)
    others = logits.scatter(-1, which, -torch.inf)
    return others.logsumexp(dim=-1) - best[..., 0]
