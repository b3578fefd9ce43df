"""What changes over a training: learning rates and exploration, as pure functions of how far it has come.

Nothing here has a state, so that going on at step N needs nothing but N.
"""

from __future__ import annotations

import math

from torch.optim import Optimizer

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.multiview import Stage
from mvtn_cli.core.training.learner import CLASSIFIER, VIEWPOINTS

WARM_UP = 0.15  # of the classifier's one-cycle
FIRST, LAST = 1 / 25, 1 / 250_000  # where it starts and ends, as shares of the peak
VIEWS_WARM_UP, VIEWS_CONSTANT_TO = 0.05, 0.6
EXPLORE_TO = 0.8
EXPLORE_DEG = 45.0


def one_cycle(progress: float) -> float:
    """Share of the peak learning rate of the classifier.

    Up along a cosine for the first 15 %, then down along another to almost nothing.

    Args:
        progress: 0 at the start of the training, 1 at its end.

    References:
        Smith, Topin. Super-convergence. 2018; the form with cosines is the one of `torch.optim.lr_scheduler`.
    """
    if progress < WARM_UP:
        return _cosine(FIRST, 1.0, progress / WARM_UP)
    return _cosine(1.0, LAST, (progress - WARM_UP) / (1.0 - WARM_UP))


def warm_constant_linear(progress: float) -> float:
    """Share of the peak learning rate of the viewpoint network.

    Up in a line for 5 %, constant to 60 %, down in a line to zero: the views must still be able to move after
    the classifier has learnt something, which is late (the phase change of the known-view task).
    """
    if progress < VIEWS_WARM_UP:
        return progress / VIEWS_WARM_UP
    return min(1.0, (1.0 - progress) / (1.0 - VIEWS_CONSTANT_TO))


def explore_deg(full_deg: float, progress: float) -> float:
    """Standard deviation of the noise on learned views in training: falls in a line to zero at 80 %."""
    return full_deg * max(0.0, 1.0 - progress / EXPLORE_TO)


def full_explore_deg(selection: str, num_views: int, asked: float | None) -> float:
    """Where the exploration starts, in degrees.

    Without noise the classifier learns a small set by heart before a view moves. The forms that stay near
    their start may only leave it by 180°/M in azimuth; half of that is noise enough.

    Args:
        selection: As in `--views`.
        num_views: M.
        asked: `--explore`; None for the automatic value.
    """
    if not selection.startswith("learned"):
        return 0.0
    if asked is not None:
        return asked
    return EXPLORE_DEG if selection == "learned-direct" else min(EXPLORE_DEG, 90.0 / num_views)


def set_all(config: TrainConfig, optimisers: dict[str, Optimizer], progress: float) -> float:
    """Set the learning rates of a step, and return its exploration in degrees.

    Args:
        config: The settings.
        optimisers: By the name of their network; each group has its highest learning rate as `peak`.
        progress: 0 at the start of the training, 1 at its end.
    """
    share = {CLASSIFIER: one_cycle(progress), VIEWPOINTS: warm_constant_linear(progress)}
    for name, optimiser in optimisers.items():
        for group in optimiser.param_groups:
            group["lr"] = group["peak"] * share[name]
    return explore_deg(full_explore_deg(config.views, config.num_views, config.explore), progress)


def stage_of(config: TrainConfig, epoch: int) -> Stage:
    """The stage that an epoch, counted from 0, belongs to."""
    return "views" if epoch < config.first_stage_epochs else "shapes"


def progress_in_stage(config: TrainConfig, epoch: int, step: int, steps: int) -> float:
    """How far the middle of a step is in its stage, 0..1: each stage has whole schedules of its own.

    Args:
        config: The settings.
        epoch: Counted from 0.
        step: Of this epoch, counted from 0.
        steps: In an epoch.
    """
    first = config.first_stage_epochs
    begin, end = (0, first) if epoch < first else (first, config.epochs)
    return ((epoch - begin) * steps + step + 0.5) / ((end - begin) * steps)


def _cosine(start: float, end: float, progress: float) -> float:
    return end + (start - end) * (1.0 + math.cos(math.pi * progress)) / 2.0
