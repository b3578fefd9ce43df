"""Loss weights dL/dI that a gradient is tried with, from harmless to hard."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

BLUR = 12 / 224  # standard deviation of the smooth weights' blur, image sides
CLASSES = 40


def gaussian_matrix(size: int, sigma: float) -> np.ndarray:
    """Blur by matrix: G x Gᵀ blurs the (size, size) image x, zero beyond the border.

    Args:
        size: Pixels along a side.
        sigma: Standard deviation, pixels.

    Returns:
        (size, size) float64, symmetric; rows away from the border sum to 1.
    """
    far = np.arange(size)[:, None] - np.arange(size)
    reach = np.arange(-(size - 1), size)
    return np.exp(-0.5 * (far / sigma) ** 2) / np.exp(-0.5 * (reach / sigma) ** 2).sum()


def white_weights(count: int, size: int, seed: int) -> Tensor:
    """Independent normal numbers, (count, 3, size, size)."""
    return torch.randn((count, 3, size, size), generator=torch.Generator().manual_seed(seed))


def smooth_weights(count: int, size: int, seed: int) -> Tensor:
    """White noise after a Gaussian blur of 12 px at 224, of root mean square 1."""
    blur = torch.from_numpy(gaussian_matrix(size, BLUR * size)).float()
    return unit_rms(blur @ white_weights(count, size, seed) @ blur)


def unit_rms(weights: Tensor) -> Tensor:
    """The same weights on the scale of the others."""
    return weights / weights.square().mean().sqrt().clamp_min(1e-30)


def network_weights(images: Tensor, seed: int) -> Tensor:
    """What an untrained ResNet-18 asks of the pixels, BatchNorm in training mode: nearly white, the hard case.

    Args:
        images: (N, 3, H, W).
        seed: Of the network's weights and the N labels.

    Returns:
        (N, 3, H, W), d cross-entropy / d images, of root mean square 1.
    """
    wanted = images.detach().clone().requires_grad_()
    _loss(resnet(seed), wanted, seed).backward()
    assert wanted.grad is not None
    return unit_rms(wanted.grad)


def resnet(seed: int) -> nn.Module:
    """ResNet-18 with random weights, channels last, in training mode."""
    from torchvision.models import resnet18

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return resnet18(weights=None, num_classes=CLASSES).to(memory_format=torch.channels_last).train()


def resnet_step(images: Tensor, seed: int) -> Callable[[], None]:
    """The yardstick: ResNet-18 forward and backward, down to the images, float32, channels last."""
    network = resnet(seed)
    wanted = images.detach().clone(memory_format=torch.channels_last).requires_grad_()

    def step() -> None:
        network.zero_grad(set_to_none=True)
        wanted.grad = None
        _loss(network, wanted, seed).backward()

    return step


def _loss(network: nn.Module, images: Tensor, seed: int) -> Tensor:
    labels = torch.randint(CLASSES, (len(images),), generator=torch.Generator().manual_seed(seed))
    return nn.functional.cross_entropy(network(images), labels)
