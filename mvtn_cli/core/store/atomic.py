"""Files that are either there as a whole or not at all, also after `kill -9` or a power cut."""

from __future__ import annotations

import os
import secrets
from contextlib import suppress
from pathlib import Path

from mvtn_cli.errors import MvtnError


def write_bytes(path: Path, data: bytes, *, durable: bool = True) -> None:
    """Write `data` under a name of its own beside `path`, and rename it to `path`.

    Any number of processes may do so at once: a reader sees one whole file or the other.

    Args:
        path: What it is called in the end.
        data: All of it.
        durable: Wait until the disk has it, so that it also survives a power cut. Not for what is checked when read
            and can be made again: waiting costs more than making a small shape.

    Raises:
        MvtnError: The folder can't be written, or the disk is full.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _write(temporary, data, durable)
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


def _write(path: Path, data: bytes, durable: bool) -> None:
    with path.open("wb") as file:
        file.write(data)
        if durable:
            file.flush()
            os.fsync(file.fileno())
