"""Names for files that are made from names of shapes, and files that are written whole or not at all."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path
from typing import Any

from mvtn_cli.console import dumps
from mvtn_cli.core.store.atomic import write_bytes
from mvtn_cli.errors import MvtnError

LONGEST = 120  # bytes; file systems end at 255, and a file has a longer name while it is written
RESERVED = r"(?i)(con|prn|aux|nul|com\d|lpt\d|cameras)(\..*)?"  # by Windows, and by cameras.json
NUMBERS = re.compile(r"\[\n\s+([-+.\deE,\s]+?)\n\s*\]")  # a list of nothing else; texts have no line breaks


def safe_name(name: str, taken: set[str]) -> str:
    """Turn a shape's name into that of a file that lies in its folder and is nobody else's.

    Two names differ also where case or the form of an accent make no difference, and the picture of one shape is
    never the folder of another.

    Args:
        name: Anything, e.g. `chair/chair_0001` or `../../etc/passwd`.
        taken: Names given so far; the new ones are added.
    """
    safe = re.sub(r"[^\w.-]+", "-", unicodedata.normalize("NFC", name)).strip(".-")
    safe = safe.encode("utf-8", "replace")[:LONGEST].decode("utf-8", "ignore").rstrip(".-") or "shape"
    if re.fullmatch(RESERVED, safe):
        safe = f"shape-{safe}"
    unique, number = safe, 2
    while _keys(unique) & taken:
        unique, number = f"{safe}-{number}", number + 1
    taken |= _keys(unique)
    return unique


def _keys(name: str) -> set[str]:
    """What a file system may take for the folder and the sheet of a shape."""
    key = name.casefold()
    return {key, f"{key}.png"}


def write_picture(path: Path, data: bytes) -> None:
    """Write a file that can be made again at any time; a reader sees the old one or the whole new one.

    Raises:
        MvtnError: The folder can't be written, or the disk is full.
    """
    try:
        write_bytes(path, data, durable=False)
    except MvtnError as error:
        error.hint = "free some space, or name another folder with --out"
        raise


def write_document(path: Path, document: Any) -> None:
    """Write JSON like `write_picture`: a line a key, a line a row of numbers.

    File names that are no text are escaped in the way that Python reads back.
    """
    text = NUMBERS.sub(lambda found: f"[{', '.join(found[1].split())}]".replace(",,", ","), dumps(document, indent=2))
    write_picture(path, (text + "\n").encode("utf-8", "backslashreplace"))
