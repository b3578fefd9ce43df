"""Which corruptions are measured."""

from __future__ import annotations

from collections.abc import Iterable

from mvtn_cli.core.robustness.corruption import Corruption, Kind
from mvtn_cli.core.robustness.occlusion import DIRECTIONS
from mvtn_cli.robustness_config import PAPER_OCCLUDE, PAPER_ROTATE, RobustnessConfig


def plan_of(config: RobustnessConfig) -> list[Corruption]:
    """List every evaluation of a run, the one of clean shapes first.

    What is random is repeated with one seed and different repeats; an occlusion has one evaluation a direction, a size
    a single one. Strengths that are named twice are measured once.
    """
    rotate, occlude = config.rotate or (), config.occlude or ()
    if config.asks_for_nothing:
        rotate, occlude = PAPER_ROTATE, PAPER_OCCLUDE
    plan = [Corruption("clean")]
    plan += _repeated("rotate", rotate, config)
    plan += _repeated("so3", (0.0,) if config.so3 else (), config)
    plan += [
        Corruption("occlude", ratio, direction=direction, crop=config.crop)
        for ratio in _distinct(occlude)
        for direction in dict.fromkeys(config.directions or DIRECTIONS)
    ]
    plan += _repeated("noise", config.noise or (), config)
    plan += _repeated("drop-points", config.drop_points or (), config)
    plan += [Corruption("scale", factor) for factor in _distinct(config.scale or ())]
    return plan


def _repeated(kind: Kind, strengths: Iterable[float], config: RobustnessConfig) -> list[Corruption]:
    return [
        Corruption(kind, strength, repeat=repeat, seed=config.seed)
        for strength in _distinct(strengths)
        for repeat in range(config.repeats)
    ]


def _distinct(strengths: Iterable[float]) -> list[float]:
    return sorted({float(strength) for strength in strengths})
