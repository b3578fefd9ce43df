"""Compiled kernels are kept between runs, in a folder named after the very source they were made from.

numba notices a change in the file of the function that it is asked for, not in the files of the functions that this one
calls: with one folder for all versions, an edit of the shading would go on drawing the old shading.
"""

from __future__ import annotations

import hashlib
import os
from functools import partial
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba import parallel_chunksize, prange

# Divisions follow IEEE 754, without a branch that raises; kernels guard theirs where it matters.
njit: Any = partial(numba.njit, cache=True, error_model="numpy")
# For functions of inner loops that take arrays and make none: a plain call counts the references of each of them, which
# makes a view four times as slow.
njit_inline: Any = partial(njit, forceinline=True, _nrt=False)

__all__ = ["kernel_folder", "njit", "njit_inline", "parallel_chunksize", "prange"]


def kernel_folder() -> Path:
    """`NUMBA_CACHE_DIR`, else a folder of the user's cache that belongs to this version of the sources."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    digest = hashlib.blake2b(numba.__version__.encode(), digest_size=8)
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())
    return Path(platformdirs.user_cache_dir("mvtn")) / "kernels" / digest.hexdigest()


numba.config.CACHE_DIR = str(kernel_folder())  # type: ignore[attr-defined]
