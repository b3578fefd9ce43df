"""A coin that falls on one side with a given probability."""

from __future__ import annotations

from numpy.random import Generator


def chance(rng: Generator, probability: float) -> bool:
    """Flip the coin once."""
    return bool(rng.random() < probability)
