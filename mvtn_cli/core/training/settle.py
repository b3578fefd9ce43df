"""BatchNorm statistics that fit the pictures of the evaluation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext

import torch
from torch.nn.modules.batchnorm import _BatchNorm

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.recogniser import Recogniser
from mvtn_cli.core.networks.synced import Share
from mvtn_cli.core.render import Look
from mvtn_cli.core.training.fixed_views import load_batch
from mvtn_cli.core.training.shapes import Shapes, alike_batches
from mvtn_cli.core.training.team import Team

SHAPES = 256


def settle_batch_norm(
    model: Recogniser,
    shapes: Shapes,
    train: Sequence[int],
    config: TrainConfig,
    each_batch: Callable[[], None] = lambda: None,
    team: Team | None = None,
) -> None:
    """Measure the running statistics anew on training shapes that are drawn as in evaluation.

    Training draws random colours and lights and lets the views roam, evaluation draws white shapes under a headlight
    from the views themselves. Statistics gathered along the way fit the former; judged with those, accuracy jumps by
    tens of points from epoch to epoch. The weights are not touched, and neither are frozen layers.

    Args:
        model: The recogniser; its running statistics change.
        shapes: The data set.
        train: Training shapes; at most 256 of them are used, spread evenly.
        config: The settings.
        each_batch: Called before each batch; may raise to end early.
        team: Processes among whom each batch is shared, all of which must call this.

    References:
        Wu, Johnson. Rethinking "Batch" in BatchNorm. 2021, section 3: precise statistics, and their domain.
    """
    layers = [layer for layer in model.modules() if isinstance(layer, _BatchNorm) and _learns(layer)]
    if not layers:
        return
    was_training = model.training
    momenta = [layer.momentum for layer in layers]
    model.eval()
    try:
        for layer in layers:
            layer.reset_running_stats()
            layer.momentum = None  # the plain average of all batches
            layer.train()
        chosen = list(train[:: max(1, len(train) // SHAPES)])[:SHAPES]
        with torch.no_grad():
            for chunk in alike_batches(shapes, chosen, config.batch_size, config.render):
                each_batch()
                if len(chunk) == 1 < len(chosen):
                    continue  # one picture alone may have nothing to take a variance of
                share = Share(len(chunk)) if team is None else team.share(chunk)
                batch, kind = load_batch(shapes, chunk[share.rows], config.render)
                with nullcontext() if team is None else team.drawing(share):
                    model(batch, Look.evaluation(config, len(batch), kind))
    finally:
        for layer, momentum in zip(layers, momenta, strict=True):
            layer.momentum = momentum
        model.train(was_training)


def _learns(layer: _BatchNorm) -> bool:
    return layer.track_running_stats and any(weight.requires_grad for weight in layer.parameters())
