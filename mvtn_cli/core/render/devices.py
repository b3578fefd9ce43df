"""Where is drawn: on the CUDA device that the cameras are on, if that can be, else on the CPU."""

from __future__ import annotations

import warnings
from functools import cache
from importlib.util import find_spec

import torch


@cache
def missing_for_cuda() -> str:
    """What the renderer lacks to draw on CUDA devices, in words; empty if nothing."""
    if find_spec("numba_cuda") is None:
        return "numba-cuda is not installed: pip install 'mvtn[cuda]'"
    try:
        from numba import cuda

        return "" if cuda.is_available() else "numba-cuda finds no driver or no NVVM"
    except Exception as error:  # a wheel for another driver raises anything
        return f"numba-cuda does not load: {' '.join(str(error).split())[:200]}"


def drawing_device(wanted: torch.device) -> torch.device:
    """Return the device that draws for cameras on another; that they are two is said once."""
    if wanted.type == "cuda":
        if not (missing := missing_for_cuda()):
            return wanted
        say_where(wanted.type, missing)
    else:
        say_where(wanted.type)
    return torch.device("cpu")


def is_gpu(device: torch.device) -> bool:
    """Whether the CUDA back end draws on such a device."""
    return device.type == "cuda"


@cache
def say_where(device: str, reason: str = "") -> None:
    """Say once that pictures for another device are drawn here and copied."""
    if device != "cpu":
        why = f" ({reason})" if reason else ""
        warnings.warn(f"pictures are drawn on the CPU and copied to {device}{why}", RuntimeWarning, stacklevel=4)
