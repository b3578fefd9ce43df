"""What differs between runs: settings, classes, confusions, seeds."""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mvtn_cli.core.reporting.comparison_runs import RunFiles
from mvtn_cli.core.training.run import NOT_SETTINGS

NOT_COMPARED = frozenset({"dataset", "name", "runs", "cache", "workers", "log"})  # machine and threads change the time
MOST_CONFUSIONS = 20
MEASURES = ("accuracy", "class_accuracy", "seconds")


def differing_settings(runs: Sequence[RunFiles]) -> list[dict[str, Any]]:
    """The settings that are not the same in all runs, in the order of `mvtn train --help`.

    Returns:
        Of each its `setting` and the `values`, one a run, as text.
    """
    from mvtn_cli.config import TrainConfig

    known = list(TrainConfig.model_fields)
    names = [*known, *sorted({name for run in runs for name in run.config} - set(known))]
    found = []
    for name in (name for name in names if name not in NOT_COMPARED):
        values = [_setting(run, name) for run in runs]
        if len(set(values)) > 1:
            found.append({"setting": name.replace("_", "-"), "values": values})
    return found


def _setting(run: RunFiles, name: str) -> str:
    from mvtn_cli.config import TrainConfig

    if (value := run.config.get(name)) is not None:
        return str(value).lower() if isinstance(value, bool) else str(value)
    fields = TrainConfig.model_fields
    return "auto" if run.config and name in fields and fields[name].default is None else "–"


def class_table(runs: Sequence[RunFiles]) -> list[dict[str, Any]]:
    """Accuracies class by class, side by side; the largest differences first.

    Args:
        runs: Evaluated on the same shapes.

    Returns:
        Of each class that occurs `name`, `count`, the `accuracies` (one a run) and their `spread`.
    """
    rows = []
    for entries in zip(*(run.result["per_class"] for run in runs), strict=True):
        if entries[0]["count"]:
            shares = [entry["accuracy"] for entry in entries]
            spread = max(shares) - min(shares)
            rows.append(
                {"name": entries[0]["name"], "count": entries[0]["count"], "accuracies": shares, "spread": spread}
            )
    return sorted(rows, key=lambda row: -row["spread"])


def confusion_table(runs: Sequence[RunFiles]) -> list[dict[str, Any]]:
    """The mistakes that differ most between runs judged on the same shapes.

    Returns:
        Up to 20, each `label` taken for `predicted`, the `count` of that class, the `counts` of the mistake (one a
        run) and their `spread`; differences of a single shape are left out.
    """
    confusions = np.array([run.result["confusion"] for run in runs], dtype=np.int64)
    classes, totals = runs[0].result["classes"], [row["count"] for row in runs[0].result["per_class"]]
    spread = confusions.max(axis=0) - confusions.min(axis=0)
    np.fill_diagonal(spread, 0)
    order = np.argsort(-spread, axis=None, kind="stable")[:MOST_CONFUSIONS]
    cells = [divmod(int(cell), len(classes)) for cell in order]
    return [
        {
            "label": classes[i],
            "predicted": classes[j],
            "count": totals[i],
            "counts": confusions[:, i, j].tolist(),
            "spread": int(spread[i, j]),
        }
        for i, j in cells
        if spread[i, j] > 1
    ]


def seed_groups(runs: Sequence[RunFiles], entries: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Runs on the same data whose settings are the same but for the seed, in the order of their first run.

    Args:
        runs: All of them.
        entries: What is said of each: `accuracy`, `class_accuracy`, `seconds`.

    Returns:
        Of each group `name`, `runs` (labels), `seeds`, and mean and sd (n - 1) of each measure over the seeds; a seed
        counts once.
    """
    groups = []
    for indices in _members(runs, [entry["seed"] for entry in entries]):
        first: dict[Any, int] = {}
        for i in indices:
            first.setdefault(entries[i]["seed"], i)
        labels = [runs[i].label for i in indices]
        group: dict[str, Any] = {
            "name": group_name(labels, [entries[i]["seed"] for i in indices]),
            "runs": labels,
            "seeds": list(first),
        }
        for measure in MEASURES:
            group[measure] = mean_and_sd([entries[i][measure] for i in first.values()])
        groups.append(group)
    return groups


def _members(runs: Sequence[RunFiles], seeds: Sequence[Any]) -> list[list[int]]:
    """Which runs belong together; where a seed comes twice, names decide, too: more than the settings differs there."""
    alike: dict[str, list[int]] = {}
    for index, run in enumerate(runs):
        alike.setdefault(identity(run), []).append(index)
    members: dict[tuple[str, str], list[int]] = {}
    for key, indices in alike.items():
        repeated = len({seeds[i] for i in indices}) < len(indices)
        for i in indices:
            members.setdefault((key, _without_seed(runs[i].label, seeds[i]) if repeated else ""), []).append(i)
    return sorted(members.values())


def identity(run: RunFiles) -> str:
    """The data and all settings of a run but the seed, as text."""
    settings = {key: value for key, value in run.config.items() if key not in NOT_SETTINGS | {"seed"}}
    return json.dumps([data_key(run), settings or str(run.path)], sort_keys=True, default=str)


def data_key(run: RunFiles) -> str:
    """What tells data sets apart: the address of their content, or their name where that was not kept."""
    return str(run.info.get("data_address") or run.info.get("dataset") or "")


def group_name(labels: Sequence[str], seeds: Sequence[Any]) -> str:
    """What the runs of a group are called without their seeds, as `fixed` for fixed-s0 and fixed-s1."""
    if len(labels) == 1:
        return labels[0]
    short = {_without_seed(label, seed) for label, seed in zip(labels, seeds, strict=True)}
    if len(short) == 1:
        return short.pop()
    more = f" and {len(labels) - 2} more" if len(labels) > 3 else ""
    return ", ".join(labels[: 2 if more else 3]) + more


def _without_seed(label: str, seed: Any) -> str:
    return re.sub(rf"[-_.]+(s|seed)?[-_.]?{seed}$", "", label)


def mean_and_sd(values: Sequence[float | None]) -> dict[str, Any]:
    """Mean and standard deviation (n - 1; None for a single value) of what is known, and how many that are."""
    known = [value for value in values if value is not None]
    return {
        "n": len(known),
        "mean": statistics.fmean(known) if known else None,
        "sd": statistics.stdev(known) if len(known) > 1 else None,
    }
