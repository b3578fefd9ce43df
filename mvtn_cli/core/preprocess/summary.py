"""What a run of `preprocess` amounts to."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from mvtn_cli.core.datasets import Item
from mvtn_cli.core.preprocess.making import Outcome


@dataclass
class Summary:
    """Counts over the whole data set, the same whether shapes were made now or found.

    Attributes:
        kept: Shapes in the store, usable.
        simplified: Of those, with fewer vertices than the file.
        mended: Of those, with something repaired.
        rejected: Items that can't be used.
        reused: Of the kept, those that needed no work.
        remade: Of the kept, those whose stored file did not verify.
        findings: One dict a finding: file, finding, fatal.
        simplifications: One dict a simplified mesh: name, vertices and faces before and after,
            error_percent, seconds (None where the time was not measured).
        seconds: Wall time.
    """

    kept: int = 0
    simplified: int = 0
    mended: int = 0
    rejected: int = 0
    reused: int = 0
    remade: int = 0
    findings: list[dict[str, Any]] = field(default_factory=list)
    simplifications: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def made(self) -> int:
        """How many shapes were worked out in this run."""
        return self.kept - self.reused

    def headline(self) -> str:
        """Return one sentence for people."""
        if self.rejected and not self.kept:
            return f"not one shape can be used: {self.rejected} rejected"
        if not self.made:
            if not self.rejected:
                return f"nothing to do: {self.kept} shapes are up to date"
            return f"nothing new: {self.kept} shapes are up to date, {self.rejected} were rejected again"
        parts = [f"{self.made} shapes made"]
        parts += [f"{self.reused} up to date"] if self.reused else []
        parts += [f"{self.rejected} rejected"] if self.rejected else []
        return ", ".join(parts) + f" in {self.seconds:.1f} s"


def summarise(pairs: Iterable[tuple[Item, Outcome]], seconds: float) -> Summary:
    """Count what became of each item, in the order of the data set."""
    summary = Summary(seconds=seconds)
    for item, outcome in pairs:
        _count(summary, outcome)
        summary.findings += [
            {"file": item.source, "finding": f"{found['name']}: {found['detail']}", "fatal": found["fatal"]}
            for found in outcome.findings
        ]
        if outcome.simplification:
            summary.simplifications.append({"name": item.name, **outcome.simplification})
    return summary


def _count(summary: Summary, outcome: Outcome) -> None:
    if outcome.state == "rejected":
        summary.rejected += 1
        return
    summary.kept += 1
    summary.simplified += outcome.simplification is not None
    summary.mended += any(found["mended"] for found in outcome.findings)
    summary.reused += outcome.state == "reused"
    summary.remade += outcome.state == "remade"
