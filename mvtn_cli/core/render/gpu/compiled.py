"""How a kernel is compiled for CUDA and launched.

A CUDA kernel may call functions made by `njit`: numba-cuda compiles their source a second time, so there is one source
for both back ends. Products and sums are never contracted to one rounding here: the CPU does not contract, and a screen
corner that rounds to another 1/256 of a sample is another face id.

In numba's simulator (`NUMBA_ENABLE_CUDASIM=1`, with `NUMBA_DISABLE_JIT=1`) the same kernels run as Python, on tensors
in main memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from threading import RLock
from typing import Any

import torch
from numba import config
from numba import cuda as numba_cuda

from mvtn_cli.core.render.compiled import kernel_folder

cuda: Any = numba_cuda
SIMULATED = bool(config.ENABLE_CUDASIM)  # type: ignore[attr-defined]
# Threads of a block, and blocks that share what is queued: a simulated thread is a whole thread of the system.
THREADS = 4 if SIMULATED else 128
QUEUE_BLOCKS = 2 if SIMULATED else 1024

if not SIMULATED:
    from numba.cuda.core import config as cuda_config

    cuda_config.CACHE_DIR = str(kernel_folder())


def kernel(function: Any) -> Any:
    """Compile for CUDA; without link-time optimisation, which would contract."""
    return cuda.jit(function) if SIMULATED else cuda.jit(cache=True, lto=False)(function)


def device_function(function: Any) -> Any:
    """A function of kernels that uses what only CUDA has; others are made by `njit`."""
    return cuda.jit(function, device=True)


_patching = RLock()


@contextmanager
def uncontracted() -> Iterator[None]:
    """Within, numba-cuda compiles without fused multiply-add, for which it has no option."""
    if SIMULATED:
        yield
        return
    from numba.cuda.cudadrv import nvvm

    with _patching:
        before = nvvm.compile_ir
        nvvm.compile_ir = lambda ir, **options: before(ir, **{"fma": False, **options})
        try:
            yield
        finally:
            nvvm.compile_ir = before


def launch(function: Any, views: int, tasks: int, *arguments: Any) -> None:
    """Run a kernel on torch's current stream: blocks of `THREADS` along x for `tasks`, views along y.

    Args:
        function: Of `kernel`.
        views: How many, up to 65,535.
        tasks: Threads that each view needs.
        arguments: Numbers, and contiguous tensors of one device, which are passed without a copy.
    """
    if views == 0 or tasks == 0:
        return
    device = next(value.device for value in arguments if isinstance(value, torch.Tensor))
    # numba takes the device that is current, which another one of torch's may be.
    with uncontracted(), nullcontext() if SIMULATED else torch.cuda.device(device):
        stream = 0 if SIMULATED else cuda.external_stream(torch.cuda.current_stream(device).cuda_stream)
        passed = [_array(value) if isinstance(value, torch.Tensor) else value for value in arguments]
        function[(-(-tasks // THREADS), views), THREADS, stream](*passed)


def _array(tensor: torch.Tensor) -> Any:
    return tensor.detach().numpy() if SIMULATED else cuda.as_cuda_array(tensor.detach())
