"""Rows for `Console.table`, and tables as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from mvtn_cli.core.reporting import words

CLASS_COLUMNS = ("class", "shapes", "right", "accuracy", "most often taken for")


def summary_rows(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The headline of an evaluation: name and value."""
    low, high = result["accuracy_interval"]
    rows = [
        (
            f"{result['split']} accuracy",
            f"{words.percent(result['accuracy'])} (95 %: {words.span(low, high)})",
        ),
        ("class accuracy", words.percent(result["class_accuracy"])),
        ("shapes", words.count(result["count"])),
    ]
    if result.get("not_finite"):
        rows.append(("without a finite answer", words.count(result["not_finite"])))
    if known := result.get("known_view"):
        rows += [
            ("median error to the known side", words.degrees(known["median_deg"])),
            ("within 30° of it", words.percent(known["within_30"])),
            ("over 90° off", words.percent(known["over_90"])),
        ]
    if baseline := result.get("baseline"):
        spread = baseline["accuracy_sd"]
        value = words.percent(baseline["accuracy"])
        rows.append(("histogram forest", value if words.unknown(spread) else f"{value} ± {words.percent(spread)}"))
    return rows


def class_rows(result: Mapping[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """One row a class, in the order of `CLASS_COLUMNS`."""
    return [
        (
            row["name"],
            str(row["count"]),
            str(row["correct"]),
            words.percent(row["accuracy"]),
            f"{row['confused_with']} ({row['confused_count']})" if row["confused_with"] is not None else "",
        )
        for row in result["per_class"]
    ]


def compare_table(rows: Sequence[Mapping[str, Any]], form: Literal["markdown", "tsv"] = "markdown") -> str:
    """Write rows with the same keys as a table; the keys of the first row are the columns.

    Cells are text as they are, and floats with four significant digits; None and NaN are a dash.
    """
    if not rows:
        return ""
    columns = list(rows[0])
    cells = [[_cell(row.get(column), form) for column in columns] for row in rows]
    if form == "tsv":
        return "\n".join("\t".join(line) for line in [[_cell(c, form) for c in columns], *cells])
    numeric = [all(isinstance(row.get(column), int | float | None) for row in rows) for column in columns]
    rule = ["---:" if right else "---" for right in numeric]
    head = [_cell(column, form) for column in columns]
    return "\n".join("| " + " | ".join(line) + " |" for line in [head, rule, *cells])


def _cell(value: Any, form: str) -> str:
    if value is None or isinstance(value, float):
        return words.number(value, 4)
    text = " ".join(str(value).split())
    return text.replace("|", "\\|") if form == "markdown" else text
