"""`mvtn doctor DATASET`: counts beside the official ones, and what would spoil a benchmark."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.options import Call
from mvtn_cli.console import counted, duration
from mvtn_cli.errors import MvtnError

if TYPE_CHECKING:
    from mvtn_cli.core.datasets import Item
    from mvtn_cli.core.preprocess.diagnosis import Diagnosis
    from mvtn_cli.core.preprocess.examination import Examined

SCHEMA = "mvtn.doctor-dataset/1"
LISTED = 10  # bad shapes and copies named on the terminal; --json names all


def examine_dataset(spec: str, workers: int | None, call: Call) -> None:
    """Read every shape of a data set, say what is wrong, and fail if it would spoil a benchmark."""
    from mvtn_cli.core.datasets import survey
    from mvtn_cli.core.preprocess.diagnosis import diagnose
    from mvtn_cli.core.preprocess.examination import examine_all

    dataset = survey(spec)
    call.console.note(f"{dataset.spec}: {dataset.title}")
    diagnosis = diagnose(dataset, examine_all(dataset.items, call.console, workers))
    _show(diagnosis, call)
    call.console.result(_document(diagnosis, call))
    if diagnosis.bad:
        raise MvtnError(
            f"this would spoil a benchmark: {', '.join(diagnosis.bad)}",
            hint="the lines marked bad say what; --json lists every shape, docs/datasets.md what is known of each set",
            code="doctor.dataset",
        )
    shapes = counted(len(dataset.items), "shape")
    call.console.note(f"{shapes} examined in {duration(call.seconds)}; next: mvtn preprocess {dataset.spec}")


def _show(diagnosis: Diagnosis, call: Call) -> None:
    columns, rows = _count_rows(diagnosis)
    call.console.table("counts", columns, rows, stream="out")
    checks = [(check.state, check.name, check.count, check.detail) for check in diagnosis.checks]
    call.console.table("checks", ["state", "check", "shapes", "detail"], checks, stream="out")
    bad = [*diagnosis.items("unreadable"), *diagnosis.items("empty")]
    lines = [f"{seen.state}: {item.source}: {seen.reason}" for item, seen in bad]
    lines += [
        "duplicates across splits: " + " = ".join(f"{item.split} {item.name}" for item in group.items)
        for group in diagnosis.duplicates
        if group.across
    ]
    for line in lines[:LISTED]:
        call.console.note(line)
    if len(lines) > LISTED:
        call.console.note(f"… and {len(lines) - LISTED} more; --json lists all")


def _count_rows(diagnosis: Diagnosis) -> tuple[list[str], list[list[object]]]:
    """Return the header and a row for each class; official counts stand behind those found, where there are any."""
    from mvtn_cli.core.preprocess.diagnosis import count_table

    table = count_table(diagnosis)
    official = diagnosis.official
    splits = [split for split, count in table[-1]["counts"].items() if count or (official and split in official.totals)]
    columns = ["class"]
    for split in splits:
        columns += [split, "official"] if official else [split]
    rows: list[list[object]] = []
    for entry in table:
        row: list[object] = [entry["class"]]
        for split in splits:
            row.append(entry["counts"][split])
            if official:
                row.append((entry["official"] or {}).get(split, ""))
        rows.append(row)
    return columns, rows


def _document(diagnosis: Diagnosis, call: Call) -> dict[str, Any]:
    from mvtn_cli.core.preprocess.diagnosis import axis_document, count_table

    dataset = diagnosis.dataset
    labels = [item.label for item in dataset.items if dataset.classes]
    return {
        "schema": SCHEMA,
        "dataset": dataset.spec,
        "title": dataset.title,
        "release": dataset.release or None,
        "ok": not diagnosis.bad,
        "shapes": len(dataset.items),
        "classes": count_table(diagnosis),
        "checks": [asdict(check) for check in diagnosis.checks],
        "unreadable": [_named(pair) for pair in diagnosis.items("unreadable")],
        "empty": [_named(pair) for pair in diagnosis.items("empty")],
        "duplicates": [
            {
                "across_splits": group.across,
                "one_class": not group.disagree,
                "shapes": [{"name": item.name, "split": item.split, "source": item.source} for item in group.items],
            }
            for group in diagnosis.duplicates
        ],
        "missing": [{"part": part.part, "whole": part.whole, "names": part.names} for part in dataset.missing],
        "inside_out": diagnosis.inside_out,
        "up_axis": axis_document(diagnosis),
        "labels": {"lowest": min(labels, default=None), "highest": max(labels, default=None)},
        "mended": dict(diagnosis.mended),
        "seconds": call.seconds,
    }


def _named(pair: tuple[Item, Examined]) -> dict[str, str]:
    item, seen = pair
    return {"name": item.name, "source": item.source, "reason": seen.reason}
