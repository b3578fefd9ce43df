"""A stored shape as bytes: an uncompressed npz that carries its own checksum.

The same shape always gives the same bytes (no dates, no run times), so that two stores can be compared with
`diff -r`.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.store.stored_shape import StoredShape

_ARRAYS = ("vertices", "faces", "normals", "colors", "points", "point_colors", "center")
_CHECKSUM_BYTES = 32


class DamagedFile(Exception):
    """The bytes are not those that were written."""


def encode(address: str, shape: StoredShape, notes: Mapping[str, Any]) -> bytes:
    """Return the npz of `shape`; `notes` is any JSON document that should travel with it.

    The archive's comment holds a checksum of all bytes before it and of the address.
    """
    arrays = {name: getattr(shape, name) for name in _ARRAYS}
    present = {name: np.ascontiguousarray(array) for name, array in arrays.items() if array is not None}
    present["scalars"] = np.array([shape.radius, shape.known_azimuth_deg], dtype=np.float64)
    present["notes"] = np.frombuffer(json.dumps(dict(notes), sort_keys=True).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **present)
    body = buffer.getvalue()[:-2] + _CHECKSUM_BYTES.to_bytes(2, "little")  # the length of the comment
    return body + _checksum(address, body)


def decode(address: str, data: bytes) -> tuple[StoredShape, dict[str, Any]]:
    """Return the shape and its notes.

    Raises:
        DamagedFile: A byte differs, the file is cut short, or it belongs to another address.
    """
    if data[-_CHECKSUM_BYTES:] != _checksum(address, data[:-_CHECKSUM_BYTES]):
        raise DamagedFile
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return _shape(arrays), json.loads(arrays["notes"].tobytes())


def _shape(arrays: Mapping[str, NDArray[Any]]) -> StoredShape:
    radius, known_azimuth_deg = arrays["scalars"].tolist()
    values: dict[str, Any] = {name: arrays.get(name) for name in _ARRAYS}
    return StoredShape(**values, radius=radius, known_azimuth_deg=known_azimuth_deg)


def _checksum(address: str, body: bytes) -> bytes:
    return blake2b(body, key=address.encode(), digest_size=_CHECKSUM_BYTES).digest()
