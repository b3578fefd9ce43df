"""What is seen from fixed cameras, as files: named arrays in an uncompressed npz that carries its own checksum.

The store does not know what the arrays mean; the renderer does (`core/render/kept_views.py`). Compression is left out:
float32 normals hardly shrink, and a step would wait for them.
"""

from __future__ import annotations

import io
import shutil
from collections.abc import Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.store.atomic import write_bytes
from mvtn_cli.core.store.shape_file import DamagedFile
from mvtn_cli.core.store.store import Store
from mvtn_cli.errors import MvtnError

LEAVE_FREE = 2 << 30  # bytes of the disk that are never filled with views: the run itself has to be saved too
_CHECKSUM_BYTES = 32
Arrays = Mapping[str, NDArray[Any]]


def views_path(store: Store, address: str) -> Path:
    """Return where the views of `address` lie or would lie."""
    return store.root / "views" / address[:2] / f"{address}.npz"


def encode(address: str, arrays: Arrays) -> bytes:
    """Return the npz; its archive comment is a checksum of all bytes before it and of the address."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **{name: np.ascontiguousarray(array) for name, array in arrays.items()})
    body = buffer.getvalue()[:-2] + _CHECKSUM_BYTES.to_bytes(2, "little")  # the length of the comment
    return body + _checksum(address, body)


def decode(address: str, data: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays.

    Raises:
        DamagedFile: A byte differs, the file is cut short, or it belongs to another address.
    """
    if data[-_CHECKSUM_BYTES:] != _checksum(address, data[:-_CHECKSUM_BYTES]):
        raise DamagedFile
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def read_views(store: Store, address: str) -> dict[str, NDArray[Any]] | None:
    """Return the arrays, or None where there is no such file.

    Raises:
        DamagedFile: There is one, and it can't be used.
    """
    try:
        data = views_path(store, address).read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise DamagedFile from error
    return decode(address, data)


def write_views(store: Store, address: str, arrays: Arrays) -> None:
    """Store the arrays atomically.

    Raises:
        MvtnError: The folder can't be written, or the disk is nearly full.
    """
    path, data = views_path(store, address), encode(address, arrays)
    if free_bytes(store.root) < LEAVE_FREE + len(data):
        raise MvtnError(
            f"the disk of {store.root} is nearly full",
            hint="free some space, or name another folder with --cache DIR or MVTN_CACHE",
            code="store.full",
        )
    write_bytes(path, data, durable=False)


def free_bytes(folder: Path) -> int:
    """Return how much room the disk of a folder has, which need not be there yet."""
    there = next((parent for parent in (folder, *folder.parents) if parent.exists()), Path("/"))
    return shutil.disk_usage(there).free


def _checksum(address: str, body: bytes) -> bytes:
    return blake2b(body, key=address.encode(), digest_size=_CHECKSUM_BYTES).digest()
