"""Two documents of `mvtn bench` side by side."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mvtn_cli.core.bench.document import SCHEMA
from mvtn_cli.core.bench.outcome import Row
from mvtn_cli.errors import DataError

# What names a row, and what is worth comparing in it.
KEYS = {
    "gradient": ("mesh", "shading", "weights", "mode"),
    "render": ("what", "mesh", "shading", "supersample", "threads"),
    "pose": ("mesh", "mode"),
    "image": ("mesh", "shading", "image_size", "supersample"),
    "stiff": ("code", "case", "drawn"),
    "skips": ("mesh", "skip"),
    "retrieval": ("what", "queries", "gallery", "dim"),
    "complexity": ("network", "stage"),
    "growth": ("stage", "shapes"),
}
FIGURES = {
    "gradient": ("cosine", "l2", "seconds"),
    "render": ("seconds", "ratio"),
    "pose": ("within_1deg", "median_deg", "seconds"),
    "image": ("rmse", "seconds"),
    "stiff": ("non_finite", "seconds"),
    "skips": ("share", "seconds", "ratio"),
    "retrieval": ("seconds", "peak_mib"),
    "complexity": ("gflops", "parameters", "seconds", "peak_mib"),
    "growth": ("cpu_seconds", "seconds", "peak_mib"),
}


def read_document(path: Path) -> dict[str, Any]:
    """Read what `mvtn bench --json` printed.

    Raises:
        DataError: It is something else.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{path} can't be read: {error.strerror}", code="bench.file") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise DataError(f"{path} is not JSON: {error}", hint=_HINT, code="bench.file") from None
    known = isinstance(content, dict) and content.get("schema") == SCHEMA and content.get("what") in KEYS
    if not known or not isinstance(content.get("rows"), list):
        raise DataError(f"{path} is not an answer of mvtn bench", hint=_HINT, code="bench.file")
    return content


_HINT = "write one with: mvtn bench gradient --json > A.json"


def compare(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[Row]:
    """Each figure of each row, in A and in B, with B / A; None where one side has none.

    Raises:
        DataError: They measure different things.
    """
    if a["what"] != b["what"]:
        raise DataError(
            f"one is about {a['what']}, the other about {b['what']}",
            hint="compare two answers of the same benchmark",
            code="bench.compare",
        )
    keys, figures = KEYS[a["what"]], FIGURES[a["what"]]
    left, right = (_by_name(document["rows"], keys) for document in (a, b))
    rows = []
    for name in dict.fromkeys([*left, *right]):
        for figure in figures:
            pair = [side[name].get(figure) if name in side else None for side in (left, right)]
            if pair != [None, None]:
                rows.append(_row(name, figure, *pair))
    summaries = (document.get("summary", {}) for document in (a, b))
    return rows + _summary_rows(*summaries)


def _by_name(rows: list[Row], keys: tuple[str, ...]) -> dict[str, Row]:
    return {" ".join(str(row.get(key)) for key in keys): row for row in rows}


def _summary_rows(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[Row]:
    numbers = [key for key in dict.fromkeys([*a, *b]) if any(_is_number(side.get(key)) for side in (a, b))]
    return [_row("summary", key, a.get(key), b.get(key)) for key in numbers]


def _row(name: str, figure: str, a: Any, b: Any) -> Row:
    return {"row": name, "figure": figure, "a": a, "b": b, "ratio": ratio(a, b)}


def ratio(a: Any, b: Any) -> float | None:
    """B / A where both are numbers: 1 where both are zero, none where A alone is."""
    if not (_is_number(a) and _is_number(b)):
        return None
    if a == 0:
        return 1.0 if b == 0 else None
    return float(b / a)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
