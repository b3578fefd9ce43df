"""`mvtn preprocess`: from files to stored shapes."""

from __future__ import annotations

from collections import Counter
from statistics import median
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.options import Call
from mvtn_cli.config import PreprocessConfig
from mvtn_cli.console import counted, duration
from mvtn_cli.errors import DataError

if TYPE_CHECKING:
    from mvtn_cli.core.datasets import Dataset
    from mvtn_cli.core.preprocess import Prepared, Summary

SCHEMA = "mvtn.preprocess/1"
LISTED = 20  # bad files named on the terminal; --json names all


def preprocess(config: PreprocessConfig, call: Call) -> None:
    """Read, repair, simplify, sample and store the shapes of a data set; what is stored is left alone.

    Example: mvtn preprocess folder:my/meshes --on-bad skip
    """
    if config.explain_layout:
        return _explain(config.dataset, call)
    from mvtn_cli.core.datasets import open_dataset
    from mvtn_cli.core.preprocess import choose_dataset
    from mvtn_cli.core.preprocess import preprocess as preprocess_dataset

    console = call.console
    dataset = open_dataset(choose_dataset(config.dataset, config, console))
    console.note(f"{dataset.spec}: {dataset.title}")
    if call.dry_run:
        return _plan(dataset, config, call)
    prepared, summary = preprocess_dataset(dataset, config, console)
    _show(summary, call)
    console.result(_document(prepared, summary, call), _text(summary))
    _judge(dataset, summary, config, call)
    made = f"{counted(summary.kept, 'shape')} in {prepared.store.root}, {duration(call.seconds)}"
    console.note(f"{made}; next: mvtn train")
    return None


def _explain(spec: str | None, call: Call) -> None:
    """Print what the data set, or each of them, should look like on disk."""
    from dataclasses import asdict

    from mvtn_cli.core.datasets.layouts import LAYOUTS, layout_of

    layouts = [layout_of(_kind(spec))] if spec and spec != "all" else list(LAYOUTS.values())
    document = {"schema": "mvtn.layouts/1", "layouts": [asdict(layout) for layout in layouts]}
    call.console.result(document, "\n\n\n".join(layout.text() for layout in layouts))
    call.console.note("nothing is downloaded: unpack a data set, then mvtn doctor DATASET looks at it")


def _kind(spec: str) -> str:
    """Return the word of a data set's kind, by what is in the folder where only a path is given."""
    from pathlib import Path

    from mvtn_cli.core.datasets import survey
    from mvtn_cli.core.datasets.layouts import LAYOUTS

    if not Path(spec).exists():
        return spec
    dataset = survey(spec)
    word = dataset.spec.partition(":")[0]
    return word if word in LAYOUTS else dataset.release.partition("-")[0] or "folder"


def _plan(dataset: Dataset, config: PreprocessConfig, call: Call) -> None:
    from mvtn_cli.core.preprocess import Settings
    from mvtn_cli.core.preprocess.memory import Memory
    from mvtn_cli.core.store import Store, cache_root

    store = Store(cache_root(config.cache))
    memory = Memory(store, dataset, Settings.of(config))
    stored = sum(memory.recall(item) is not None for item in dataset.items)
    plan: dict[str, Any] = {
        "dataset": dataset.spec,
        "shapes": len(dataset.items),
        "classes": len(dataset.classes),
        **{split: dataset.count(split) for split in ("train", "val", "test")},
        "stored": stored,
        "to_do": len(dataset.items) - stored,
        "cache": str(store.root),
    }
    call.console.result({"schema": SCHEMA, "dry_run": True, **plan}, _lines(plan))
    call.console.note("nothing was written: this was a dry run")


def _document(prepared: Prepared, summary: Summary, call: Call) -> dict[str, Any]:
    counts = ("kept", "simplified", "mended", "rejected", "reused")
    return {
        "schema": SCHEMA,
        "dataset": prepared.spec,
        "title": prepared.title,
        "address": prepared.address,
        "cache": prepared.store.root,
        **{name: getattr(summary, name) for name in counts},
        "findings": summary.findings,
        "simplifications": summary.simplifications,
        "seconds": call.seconds,
    }


def _text(summary: Summary) -> str:
    return _lines({name: getattr(summary, name) for name in ("kept", "simplified", "mended", "rejected", "reused")})


def _lines(values: dict[str, Any]) -> str:
    return "\n".join(f"{name}\t{value}" for name, value in values.items())


def _show(summary: Summary, call: Call) -> None:
    """Narrate what was found: reasons by count, how good the simplification is, the bad files by name."""
    reasons = Counter(finding["finding"].split(":")[0] for finding in summary.findings if not finding["fatal"])
    fatal = Counter(finding["finding"].split(":")[0] for finding in summary.findings if finding["fatal"])
    rows = [("kept", summary.kept, f"{summary.reused} of them were up to date")]
    if summary.simplifications:
        rows.append(("simplified", summary.simplified, _simplification_words(summary.simplifications)))
    rows.append(("mended", summary.mended, _census(reasons)))
    rows.append(("rejected", summary.rejected, _census(fatal)))
    if summary.made or summary.rejected:
        call.console.table("shapes", ["", "count", ""], rows)
    bad = [finding for finding in summary.findings if finding["fatal"]]
    for finding in bad[:LISTED]:
        call.console.note(f"bad: {finding['file']}: {finding['finding']}")
    if len(bad) > LISTED:
        call.console.note(f"… and {len(bad) - LISTED} more; --json lists all")


def _simplification_words(simplifications: list[dict[str, Any]]) -> str:
    errors = [entry["error_percent"] for entry in simplifications if entry["error_percent"] is not None]
    seconds = [entry["seconds"] for entry in simplifications if entry["seconds"] is not None]
    parts = [f"error median {median(errors):.2f} %, worst {max(errors):.2f} % of the radius"] if errors else []
    parts += [f"{median(seconds):.2f} s a mesh"] if seconds else []
    return "; ".join(parts)


def _census(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {name}" for name, count in counts.most_common())


def _judge(dataset: Dataset, summary: Summary, config: PreprocessConfig, call: Call) -> None:
    if not summary.rejected:
        return
    message = f"{summary.rejected} of {len(dataset.items)} shapes can't be used"
    if config.on_bad == "fail" or not summary.kept:
        hint = "mend or remove them, or go on without them: --on-bad skip" if summary.kept else ""
        raise DataError(message, hint=hint, code="dataset.bad-files")
    call.console.warn(f"{message} and are left out")
