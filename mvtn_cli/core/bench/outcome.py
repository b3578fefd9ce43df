"""What a benchmark hands back."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

Row = dict[str, Any]


@dataclass(frozen=True)
class Outcome:
    """Rows, and what they come to.

    Attributes:
        rows: One dict a measured setting, all of the same keys.
        summary: The few numbers that a program wants.
        notes: What else belongs into the document: settings of the truth, failing views.
        omitted: What could not be measured, and why.
    """

    rows: list[Row]
    summary: dict[str, Any]
    notes: dict[str, Any] = field(default_factory=dict)
    omitted: tuple[dict[str, str], ...] = ()
