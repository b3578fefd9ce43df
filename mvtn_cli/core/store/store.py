"""The artifact directory and its rules.

    shapes/ab/abcdef….npz    preprocessed shapes, by content address
    datasets/….json          which file has which address, one list a data set and setting
    views/, descriptors/     what other stages keep
    locks/                   who is at work on what

Correctness rests on the atomic rename and the checksum alone. Locks only keep two processes from doing the
same work twice: they may fail on a network file system without harm.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple

import platformdirs
from filelock import FileLock

from mvtn_cli.core.store import shape_file
from mvtn_cli.core.store.atomic import write_bytes
from mvtn_cli.core.store.stored_shape import StoredShape
from mvtn_cli.errors import choose_error

KINDS = ("shapes", "datasets", "views", "descriptors")


class KindSize(NamedTuple):
    """How much of one kind there is."""

    files: int
    bytes: int


def cache_root(option: Path | str | None = None) -> Path:
    """Return the artifact directory: the option, else `MVTN_CACHE`, else the platform's user cache."""
    chosen = option or os.environ.get("MVTN_CACHE") or platformdirs.user_cache_dir("mvtn", appauthor=False)
    return Path(chosen).expanduser().absolute()


def digest(*parts: bytes | str) -> str:
    """Return the content address of `parts`: 40 hexadecimal digits of BLAKE2b.

    Each part is preceded by its length, so that ("ab", "c") and ("a", "bc") differ.
    """
    state = blake2b(digest_size=20)
    for part in parts:
        data = os.fsencode(part) if isinstance(part, str) else part
        state.update(len(data).to_bytes(8, "little"))
        state.update(data)
    return state.hexdigest()


class Store:
    """Reads and writes artifacts below `root`; safe for many threads and processes at once."""

    def __init__(self, root: Path | str) -> None:
        self.root = Path(root)

    def __repr__(self) -> str:
        return f"Store({str(self.root)!r})"

    # Shapes

    def shape_path(self, address: str) -> Path:
        """Return where the shape of `address` lies or would lie."""
        return self.root / "shapes" / address[:2] / f"{address}.npz"

    def read(self, address: str) -> StoredShape | None:
        """Return the shape, or None if it is missing or its checksum is wrong."""
        found = self.read_with_notes(address)
        return found[0] if found else None

    def read_with_notes(self, address: str) -> tuple[StoredShape, dict[str, Any]] | None:
        """Like `read`, with the notes that were written with the shape."""
        try:
            return shape_file.decode(address, self.shape_path(address).read_bytes())
        except (OSError, shape_file.DamagedFile):
            return None

    def write(self, address: str, shape: StoredShape, notes: Mapping[str, Any] | None = None) -> None:
        """Store `shape` atomically; `notes` must depend on nothing but the address."""
        write_bytes(self.shape_path(address), shape_file.encode(address, shape, notes or {}), durable=False)

    def stamp(self, address: str) -> tuple[int, int] | None:
        """Return (bytes, modification time in ns) of a stored shape, or None if it is missing."""
        return file_stamp(self.shape_path(address))

    @contextmanager
    def lock(self, address: str) -> Iterator[None]:
        """Hold the lock of `address` while working on it; a dead process lets go of its locks.

        4,096 lock files serve all addresses: few enough to leave lying there, enough that strangers seldom
        meet.
        """
        path = self.root / "locks" / f"{address[:3]}.lock"
        lock = FileLock(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            lock.acquire()
        except (OSError, NotImplementedError):
            # No locks on this file system, or nothing may be written: work may be done twice, never wrongly.
            yield
            return
        try:
            yield
        finally:
            lock.release()

    # Indices

    def index_path(self, name: str) -> Path:
        """Return the path of the index `name`, such as `last/0123abcd`."""
        return self.root / "datasets" / f"{name}.json"

    def read_index(self, name: str) -> dict[str, Any] | None:
        """Return an index, or None if it is missing or no JSON object: whoever asks makes it again."""
        try:
            document = json.loads(self.index_path(name).read_bytes())
        except (OSError, ValueError, RecursionError):
            return None
        return document if isinstance(document, dict) else None

    def write_index(self, name: str, document: Mapping[str, Any]) -> None:
        """Write an index atomically."""
        write_bytes(self.index_path(name), json.dumps(document, allow_nan=False).encode())

    # Housekeeping

    def sizes(self) -> dict[str, KindSize]:
        """Return files and bytes of each kind; runs are the user's work and not among them."""
        return {kind: _folder_size(self.root / kind) for kind in KINDS}

    def clear(self, kind: str = "all") -> dict[str, KindSize]:
        """Delete one kind, or all, and return what was deleted.

        Raises:
            UsageError: There is no such kind.
        """
        if kind not in (*KINDS, "all"):
            raise choose_error("kind of artifact", kind, (*KINDS, "all"))
        chosen = KINDS if kind == "all" else (kind,)
        removed = {name: size for name, size in self.sizes().items() if name in chosen}
        for name in (*chosen, *(["locks"] if kind == "all" else [])):
            shutil.rmtree(self.root / name, ignore_errors=True)
        return removed


def file_stamp(path: Path | str) -> tuple[int, int] | None:
    """Return (bytes, modification time in ns), which tell whether a file changed; None if it is missing."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


def _folder_size(folder: Path) -> KindSize:
    files = total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            stamp = file_stamp(os.path.join(parent, name))
            if stamp is not None:
                files, total = files + 1, total + stamp[0]
    return KindSize(files, total)
