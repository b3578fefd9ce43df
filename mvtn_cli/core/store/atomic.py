"""Files that are either there as a whole or not at all, also after `kill -9` or a power cut."""

from __future__ import annotations

import os
import secrets
from contextlib import suppress
from pathlib import Path

from mvtn_cli.errors import MvtnError


def write_bytes(path: Path, data: bytes) -> None:
    """Write `data` under a name of its own beside `path`, flush it to the disk, and rename it to `path`.

    Any number of processes may do so at once: a reader sees one whole file or the other.

    Raises:
        MvtnError: The folder can't be written, or the disk is full.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _write_through(temporary, data)
        os.replace(temporary, path)
    except OSError as error:
        raise MvtnError(
            f"can't write {path}: {error.strerror or error}",
            hint="free some space, or name another folder with --cache DIR or MVTN_CACHE",
            code="store.not-writable",
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def _write_through(path: Path, data: bytes) -> None:
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
