"""Finished evaluations of a run, one line of JSON each: what is done is not done again.

A line is written when its evaluation ends, so that whatever ends the process costs the one evaluation that it was at.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from mvtn_cli.console import dumps
from mvtn_cli.errors import MvtnError

FILE = "robustness.cells.jsonl"
NEEDED = frozenset({"key", "kind", "strength", "variant", "count", "correct", "predicted", "points_left", "area_left"})

Cell = dict[str, Any]


def read_cells(folder: Path) -> dict[str, Cell]:
    """Return the finished evaluations of a run by their keys; a line that was cut off or damaged is left out."""
    try:
        lines = (folder / FILE).read_bytes().splitlines()
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise MvtnError(
            f"can't read {folder / FILE}: {error.strerror or error}",
            hint="delete it, to measure anew",
            code="run.cells",
        ) from error
    cells = [cell for cell in map(_read, lines) if cell is not None]
    return {cell["key"]: cell for cell in cells}


def append_cell(folder: Path, cell: Cell) -> None:
    """Add a finished evaluation in one write, on a line of its own even where the last one was cut off."""
    path = folder / FILE
    try:
        with path.open("ab+") as file:
            torn = file.seek(0, os.SEEK_END) > 0 and _last_byte(path) != b"\n"
            file.write(b"\n" * torn + dumps(cell).encode() + b"\n")
    except OSError as error:
        raise MvtnError(
            f"can't write {path}: {error.strerror or error}",
            hint="free some space, or copy the run to a folder of your own",
            code="run.cells",
        ) from error


def _last_byte(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1)


def _read(line: bytes) -> Cell | None:
    try:
        cell = json.loads(line)
    except ValueError:
        return None
    return cell if isinstance(cell, dict) and cell.keys() >= NEEDED else None
