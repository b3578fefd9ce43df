"""Which device, how much memory it has, and how many threads."""

from __future__ import annotations

from pathlib import Path

import numba
import psutil
import torch

from mvtn_cli.errors import UsageError


def choose_device(name: str = "auto") -> torch.device:
    """Turn `--device` into a device; `auto` is CUDA where there is any, else the CPU.

    Raises:
        UsageError: This machine, or this torch, does not have it.
    """
    if name == "auto":
        return torch.device("cuda", 0) if torch.cuda.is_available() else torch.device("cpu")
    device = torch.device(name)
    missing = (
        (device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count())
        or (device.type == "mps" and not torch.backends.mps.is_available())
    )  # fmt: skip
    if missing:
        raise UsageError(
            f"device '{name}' is not there (torch {torch.__version__})",
            hint="use --device cpu, or see what `mvtn doctor` says about this machine",
            code="device.missing",
        )
    return torch.device("cuda", device.index or 0) if device.type == "cuda" else device


def shared_device(device: str, here: int) -> torch.device:
    """The kind of device of all processes of a machine.

    Raises:
        UsageError: It is one device, or there are fewer than processes.
    """
    place = choose_device(device)
    if place.type not in ("cpu", "cuda") or ":" in device:
        raise UsageError(
            f"several processes can't share device '{device}'",
            hint="use --device cuda (each process takes a GPU of its own) or --device cpu",
            code="device.shared",
        )
    if place.type == "cuda" and torch.cuda.device_count() < here:
        raise UsageError(
            f"{here} processes need a GPU each, and this machine has {torch.cuda.device_count()}",
            hint=f"use --devices {torch.cuda.device_count()}, or --device cpu",
            code="device.shared",
        )
    return place


def use_threads(threads: int | None) -> None:
    """Let networks and renderer use this many CPU threads; None leaves both as they are."""
    if threads is None:
        return
    # numba first: where its threads are OpenMP's, starting them gives torch as many as there are cores
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
    torch.set_num_threads(threads)


def use_mixed(precision: str, device: torch.device) -> bool:
    """Whether networks are trained in bfloat16 where that is safe; `auto`: on GPUs that have it."""
    if precision == "auto":
        return device.type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False)
    return precision == "bf16"


def memory_of(device: torch.device) -> int:
    """Bytes of a device's memory: all of it, or what this process is allowed of it."""
    if device.type == "cuda":
        return int(torch.cuda.get_device_properties(device).total_memory)
    if device.type == "mps":
        return int(torch.mps.recommended_max_memory())
    return min([psutil.virtual_memory().total, *memory_limits()])


def memory_limits(root: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")) -> list[int]:
    """Bytes that Linux allows this process: set by containers and batch systems on its group or one above.

    Args:
        root: Where the groups of both kinds are.
        own: Says which one this process is in, for each kind.
    """
    try:
        lines = [line.split(":", 2) for line in own.read_text(encoding="utf-8").splitlines()]
    except OSError:
        lines = []
    places = {root / "memory.max", root / "memory" / "memory.limit_in_bytes"}
    for _, kind, group in lines:
        base, name = (root, "memory.max") if not kind else (root / "memory", "memory.limit_in_bytes")
        place = base / group.lstrip("/")
        places |= {folder / name for folder in (place, *place.parents) if folder.is_relative_to(base)}
    limits = []
    for place in places:
        try:
            limits.append(int(place.read_text(encoding="ascii")))
        except (OSError, ValueError):  # no such group, or "max"
            continue
    return limits
