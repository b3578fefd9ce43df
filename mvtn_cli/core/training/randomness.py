"""Where the randomness of a training comes from: every draw of a step depends on (seed, epoch, step) alone.

So a training that was stopped anywhere goes on with the very numbers it would have drawn.
"""

from __future__ import annotations

import numpy as np
import torch

_ORDER, _STEP, _EVALUATION = 1, 2, 3


def step_seed(seed: int, epoch: int, step: int) -> int:
    """A 63-bit number for one step."""
    return _mix(_STEP, seed, epoch, step)


def step_generator(seed: int, epoch: int, step: int) -> torch.Generator:
    """The generator that everything random in one training step draws from (on the CPU)."""
    return torch.Generator().manual_seed(step_seed(seed, epoch, step))


def evaluation_generator(seed: int, number: int) -> torch.Generator:
    """The generator of evaluation batch `number`: random views are the same ones each time."""
    return torch.Generator().manual_seed(_mix(_EVALUATION, seed, 0, number))


def epoch_batches(indices: list[int], batch_size: int, seed: int, epoch: int) -> list[list[int]]:
    """Shuffle the training indices and cut them into batches.

    A last batch of a single shape would give BatchNorm nothing to normalise by; it joins the batch before it.

    Args:
        indices: What to train on, at least two.
        batch_size: Shapes a batch.
        seed: Of the run.
        epoch: From 0.
    """
    order = np.random.default_rng(_mix(_ORDER, seed, epoch, 0)).permutation(len(indices))
    shuffled = [indices[i] for i in order]
    batches = [shuffled[i : i + batch_size] for i in range(0, len(shuffled), batch_size)]
    if len(batches) > 1 and len(batches[-1]) == 1:
        batches[-2:] = [batches[-2] + batches[-1]]
    return batches


def _mix(*numbers: int) -> int:
    words = np.random.SeedSequence(numbers).generate_state(2, np.uint32)
    return (int(words[0]) << 31) ^ int(words[1])
