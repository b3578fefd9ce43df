"""Getting at a file's bytes, and the words for a file that can't be read."""

from __future__ import annotations

import os
from pathlib import Path

from mvtn_cli.errors import DataError

MAX_FILE_BYTES = 512 * 2**20  # the largest ModelNet file has about 30 MB; more is a scan, or a mistake

# First bytes, and what such a file is. A user sees "it looks like a PNG picture" instead of a riddle.
_SIGNATURES: tuple[tuple[bytes, str], ...] = (
    (b"\x89PNG", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"GIF8", "a GIF picture"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"\x89HDF", "an HDF5 file"),
    (b"\x93NUMPY", "a NumPy file"),
    (b"glTF", "a binary glTF file"),
    (b"ply", "a PLY file"),
    (b"OFF", "an OFF file"),
    (b"solid ", "an ASCII STL file"),
    (b"version https://git-lfs", "a Git LFS pointer, not the file itself"),
    (b"<!DOCTYPE", "a web page"),
    (b"<html", "a web page"),
    (b"\xfe\xff", "UTF-16 text"),
    (b"\xff\xfe", "UTF-16 text"),
)


def shown(path: str | os.PathLike[str]) -> str:
    """Return a file name as one printable line, whatever bytes it has."""
    return printable(os.fsencode(path).decode("utf-8", "backslashreplace"))


def printable(text: str) -> str:
    """Return text as one line, with escapes for what can't be printed."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def unreadable(path: Path, what: str, *, expected: str = "", line: int | None = None, hint: str = "") -> DataError:
    """Build the one-line error for a file: which, where, what was wrong, what was expected."""
    where = shown(path) if line is None else f"{shown(path)}, line {line}"
    message = f"{where}: {what[:300]}" + (f"; expected {expected}" if expected else "")
    return DataError(printable(message), hint=hint, code="shapes.unreadable")


def not_a(path: Path, format_name: str, data: bytes, *, expected: str = "") -> DataError:
    """Build the error for a file that is not what its suffix says."""
    kind = next((kind for start, kind in _SIGNATURES if data.startswith(start)), None)
    found = f" (it looks like {kind})" if kind else ""
    return unreadable(path, f"is not {format_name}{found}", expected=expected)


def quoted(token: bytes) -> str:
    """Return a piece of a file for an error message: printable, and short."""
    text = printable(token.decode("ascii", "backslashreplace"))
    return f"'{text[:30]}…'" if len(text) > 30 else f"'{text}'"


def check_file(path: Path) -> int:
    """Return the size in bytes of a regular file that is worth opening.

    Raises:
        DataError: Not there, not a file (a pipe would block), empty, or larger than `MAX_FILE_BYTES`.
    """
    try:
        if not path.exists():
            raise unreadable(path, "there is no such file")
        if not path.is_file():
            raise unreadable(path, "is a folder or device", expected="a file")
        size = path.stat().st_size
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise unreadable(path, f"can't be opened ({_reason(error)})") from error
    if size == 0:
        raise unreadable(path, "is empty (0 bytes)")
    if size > MAX_FILE_BYTES:
        raise unreadable(
            path, f"has {size / 2**20:.0f} MiB", expected=f"at most {MAX_FILE_BYTES / 2**20:.0f} MiB",
            hint="simplify the mesh, or thin the points out, before",
        )  # fmt: skip
    return size


def read_bytes(path: Path) -> bytes:
    """Return a file's bytes; every way in which that can fail is a `DataError`."""
    check_file(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise unreadable(path, f"can't be read ({_reason(error)})") from error


def read_text(path: Path, kind: str) -> bytes:
    """Return the bytes of a text file, without a UTF-8 byte order mark.

    Bytes, not str: names and comments inside may be in any encoding, the numbers are ASCII.

    Raises:
        DataError: Binary, UTF-16, or blank.
    """
    data = read_bytes(path).removeprefix(b"\xef\xbb\xbf")
    if data.startswith((b"\xfe\xff", b"\xff\xfe")) or b"\0" in data:
        raise not_a(path, f"{kind} text", data, expected="ASCII or UTF-8 without zero bytes")
    if not data.strip():
        raise unreadable(path, "holds only blanks", expected=f"{kind} text")
    return data


def _reason(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error) or type(error).__name__).splitlines()[0]
