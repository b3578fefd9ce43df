"""What a worker must have and see: the same mvtn, the same artifact directory, the same sources."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from mvtn_cli import __version__
from mvtn_cli.core.store.atomic import write_bytes
from mvtn_cli.errors import MvtnError


@dataclass(frozen=True)
class Badge:
    """What the client has; a worker with anything else would store wrong shapes, or store them elsewhere.

    Attributes:
        version: Of mvtn.
        files: Absolute paths and sizes of files that only the shared folders have.
    """

    version: str
    files: tuple[tuple[str, int], ...]

    def check(self, where: str) -> None:
        """Compare with this process.

        Args:
            where: How this machine is called in an error.

        Raises:
            MvtnError: It has another version of mvtn, or does not see a file.
        """
        if __version__ != self.version:
            raise other_version(where, __version__, self.version)
        for path, size in self.files:
            if _size(path) != size:
                raise MvtnError(
                    f"{where} does not see {path}",
                    hint="artifact directory, data and runs must lie under the same path on all machines: see "
                    "docs/scale.md",
                    code="cluster.not-shared",
                )


@contextmanager
def badge_of(shared: Path, needs: Iterable[Path | str]) -> Iterator[Badge]:
    """Leave a file of a random name in the artifact directory for a while, and write down what else must be seen.

    Raises:
        MvtnError: The directory can't be written.
    """
    marker = shared / f".cluster-{secrets.token_hex(8)}"
    write_bytes(marker, b"mvtn looks whether its workers see this folder\n", durable=False)
    try:
        files = [str(path) for path in (marker, *(Path(need).absolute() for need in needs))]
        yield Badge(__version__, tuple((path, size) for path in files if (size := _size(path)) is not None))
    finally:
        with suppress(OSError):
            marker.unlink()


def other_version(where: str, theirs: str | None, ours: str | None) -> MvtnError:
    """The error for a machine of the cluster with another mvtn, or none."""
    has = f"has mvtn {theirs}" if theirs else "has no mvtn"
    return MvtnError(
        f"{where} {has}, this machine {ours}",
        hint="install the same version on all machines of the cluster",
        code="cluster.other-version",
    )


def _size(path: str) -> int | None:
    try:
        return os.stat(path).st_size
    except OSError:
        return None
