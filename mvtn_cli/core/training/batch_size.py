"""`--batch-size auto`: as many shapes a step as the memory of a device holds.

The answer rests on the size of the memory and not on what is free of it, so that the same command means the same run.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensorMode

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.networks.recogniser import Recogniser, build_recogniser
from mvtn_cli.core.training.device import choose_device, memory_of, use_mixed
from mvtn_cli.core.training.split import training_indices
from mvtn_cli.core.views import camera_positions
from mvtn_cli.errors import MvtnError

USUAL, MOST = 32, 256  # shapes a step: of all trainings, and of those whose epochs have enough steps even so
STEPS = 64  # that are enough
SHARE = {"cpu": 0.6, "cuda": 0.8, "mps": 0.5}  # of the memory that a training may take
BESIDE = 1 << 30  # bytes for what does not grow with the batch: program, stored shapes, buffers of the renderer
HEADROOM = 1.5  # of a step's peak over what it keeps for the backward pass: that pass needs room of its own
SAMPLE_BYTES, PIXEL_BYTES = 33, 76  # of the renderer's buffers; a picture and its gradient count to the pixel


def common_batch_size(
    configs: Iterable[TrainConfig], prepared: Any, console: Console, *, here: int = 1, size: int = 1
) -> int:
    """The batch size with which each of some trainings fits, and say it; arguments as for `fitting_batch_size`."""
    chosen = min(
        fitting_batch_size(one, len(prepared.classes), len(training_indices(one, prepared).train), here=here, size=size)
        for one in configs
    )
    console.note(f"batch size {chosen} (auto)")
    return chosen


def fitting_batch_size(
    config: TrainConfig, num_classes: int, train_shapes: int, *, here: int = 1, size: int = 1
) -> int:
    """The largest power of two of shapes whose step fits into memory.

    At most 32, or up to 256 where an epoch still has 64 steps: rates are made for such batches.

    Args:
        config: Of the training; its batch size does not count.
        num_classes: C.
        train_shapes: Shapes of an epoch.
        here: Processes of the training on this machine.
        size: Processes in all; a batch is shared by them.

    Raises:
        MvtnError: Not even two shapes fit.
    """
    device = choose_device(config.device)
    wanted = max(USUAL, min(MOST, train_shapes // STEPS))
    model = build_recogniser(config, num_classes, read_weights=False)
    room = SHARE[device.type] * memory_of(device) / (1 if device.type == "cuda" else here)
    room -= BESIDE + 16 * sum(weight.numel() for weight in model.parameters())  # with gradients and moments
    fitting = int(room // bytes_of_shape(model, config, mixed=use_mixed(config.precision, device))) * size
    if fitting < 2:
        raise MvtnError(
            f"the memory of {device} ({memory_of(device) / 2**30:.1f} GiB) does not hold a step of two shapes",
            hint="try a smaller --image-size, fewer --num-views, a smaller --backbone, or --batch-size 2 all the same",
            code="memory",
        )
    return 1 << (min(wanted, fitting).bit_length() - 1)


def bytes_of_shape(model: Recogniser, config: TrainConfig, *, mixed: bool = False) -> float:
    """Bytes at the peak of a training step that each shape adds; the networks are walked through without computing.

    Args:
        model: On the CPU.
        config: Its settings.
        mixed: Whether it is trained in bfloat16.
    """
    model = copy.deepcopy(model)  # statistics of BatchNorm are changed
    with FakeTensorMode(allow_non_fake_inputs=True), torch.autocast("cpu", torch.bfloat16, enabled=mixed):
        few, more = (_kept_bytes(lambda count=count: _loss(model, config, count)) for count in (2, 4))  # type: ignore[misc]
    pixels = config.num_views * config.image_size**2 if model.uses_views else 0
    return HEADROOM * (more - few) / 2 + pixels * (SAMPLE_BYTES * config.supersample**2 + PIXEL_BYTES)


def _loss(model: Recogniser, config: TrainConfig, count: int) -> Tensor:
    """Of `count` shapes with any pictures."""
    model.train()
    points = torch.zeros(count, config.encoder_points, 3)
    labels = torch.zeros(count, dtype=torch.int64)
    if not model.uses_views:
        return model.loss(model.network(points), labels)
    azimuth, elevation = (start.expand(count, -1) for start in model.selector.start)
    if model.selector.learned:  # others keep nothing, and may not have been read yet
        cameras = model.selector.place(points, training=True).cameras
        azimuth, elevation = cameras.azimuth_deg, cameras.elevation_deg
    images = torch.zeros(count, config.num_views, 3, config.image_size, config.image_size, requires_grad=True)
    directions = camera_positions(azimuth, elevation, 1.0).to(images)
    return model.loss(model.network(images, directions, points), labels)


def _kept_bytes(forward: Callable[[], Tensor]) -> int:
    """What a forward pass keeps for its backward pass, each storage once."""
    kept: dict[int, torch.UntypedStorage] = {}

    def keep(values: Tensor) -> Tensor:
        storage = values.untyped_storage()
        kept[storage._cdata] = storage
        return values

    with torch.autograd.graph.saved_tensors_hooks(keep, lambda values: values):
        loss = forward()
    total = sum(storage.nbytes() for storage in kept.values())
    del loss
    return total
