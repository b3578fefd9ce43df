"""What `mvtn bench` measures: error and cost of the renderer, always both."""

from mvtn_cli.core.bench.compare import compare, read_document
from mvtn_cli.core.bench.document import document, write_csv
from mvtn_cli.core.bench.measure import measure
from mvtn_cli.core.bench.outcome import Outcome
from mvtn_cli.core.bench.plan import Plan, departures, plan_for
from mvtn_cli.core.bench.subjects import Subject, builtin_subjects

__all__ = [
    "Outcome",
    "Plan",
    "Subject",
    "builtin_subjects",
    "compare",
    "departures",
    "document",
    "measure",
    "plan_for",
    "read_document",
    "write_csv",
]
