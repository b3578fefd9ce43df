"""The files of an evaluation: written whole or not at all, and read back by the report."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mvtn_cli.console import dumps, plain
from mvtn_cli.core.training.checkpoint import write_run_file


def write_json(path: Path, document: Mapping[str, Any]) -> Path:
    """Write a document that any JSON reader takes: NaN and infinities become null."""
    write_run_file(path, (dumps(document, indent=2) + "\n").encode())
    return path


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Write a table: floats with six significant digits, NaN as an empty cell, names quoted where need be."""
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_cell(value) for value in row] for row in rows)
    write_run_file(path, buffer.getvalue().encode())
    return path


def read_csv(path: Path) -> list[dict[str, str]]:
    """Read a table that `write_csv` wrote, one dictionary of texts a row."""
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def _cell(value: Any) -> Any:
    value = plain(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else value
