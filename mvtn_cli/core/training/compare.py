"""Several ways of choosing views on one budget, with several seeds, and how sure the differences are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from mvtn_cli.config import SELECTIONS, TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.training.checkpoint import write_json
from mvtn_cli.core.training.find import dataset_word
from mvtn_cli.core.training.group import check_can_be_tested, check_one_process, free_group, predict_test, train_one
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import UsageError, choose_error

CONFIDENCE = 0.95


def compare(
    config: TrainConfig,
    selections: Sequence[str],
    seeds: int,
    prepared: Any,
    console: Console,
    *,
    evaluate: Callable[[Run], float] | None = None,
) -> dict[str, Any]:
    """Train each selection with each seed, one after another, and compare their test accuracies.

    Each training is an ordinary run `NAME/SELECTION-sSEED`. The same command again goes on where it was:
    finished runs are taken as they are.

    Args:
        config: The settings that all have in common; seeds count up from its own.
        selections: As in `--views`; `learned` is learned-spherical or learned-circular, after the layout.
        seeds: Trainings a selection.
        prepared: The data set.
        console: Where progress is shown.
        evaluate: Gives the test accuracy of a finished run; None takes its best weights and the test split.

    Returns:
        `name`, `path`, `split`, `seeds`, `selections` (see `summarise`) and `differences` (see
        `paired_differences`); also written to compare.json.

    Raises:
        Interrupted: As `train`.
        UsageError: An unknown selection.
        DataError: There is nothing to test on.
    """
    check_one_process("a comparison")
    names = [full_selection(name, config.layout) for name in selections]
    numbers = range(config.seed, config.seed + seeds)
    plan = {(name, seed): _settings_of_one(config, name, seed) for seed in numbers for name in names}
    for name in names:  # what can't be trained is said before hours have gone into the others
        build_recogniser(plan[name, config.seed], len(prepared.classes), read_weights=False)
    named = {_run_word(*key): one for key, one in plan.items()}
    word = f"compare-{dataset_word(prepared.spec)}-{config.num_views}v"
    group = config.name or free_group(config.runs, word, named, prepared)
    if evaluate is None:
        check_can_be_tested(prepared)
    judge = evaluate or (lambda run: predict_test(run, prepared, config.device, console).accuracy)
    results: dict[str, list[float]] = {name: [] for name in names}
    runs: dict[str, list[str]] = {name: [] for name in names}
    for (name, seed), one in plan.items():  # by seed first, so that an early stop leaves whole pairs
        run = train_one(one, f"{group}/{_run_word(name, seed)}", prepared, console)
        results[name].append(judge(run))
        runs[name].append(str(run.path))
        console.note(f"{name}, seed {seed}: test accuracy {results[name][-1]:.1%}")
    table = {
        "name": group,
        "path": str(Path(config.runs) / group),
        "split": "test",
        "seeds": list(numbers),
        "selections": [{"selection": name, **summarise(results[name]), "runs": runs[name]} for name in names],
        "differences": paired_differences(results),
    }
    write_json(Path(config.runs) / group / "compare.json", table)
    return table


def full_selection(name: str, layout: str) -> str:
    """The selection that a word means; `learned` goes by the layout.

    Raises:
        UsageError: There is no such selection.
    """
    if name == "learned":
        if layout not in ("circular", "spherical"):
            raise UsageError(
                f"there are no learned {layout} views",
                hint="use --layout spherical or circular, or learned-direct",
            )
        return f"learned-{layout}"
    if name not in SELECTIONS:
        raise choose_error("view selection", name, [*SELECTIONS, "learned"])
    return name


def summarise(accuracies: Sequence[float]) -> dict[str, Any]:
    """Mean and standard deviation (n - 1; None for a single value) of the accuracies of a selection."""
    values = np.asarray(accuracies, np.float64)
    spread = float(values.std(ddof=1)) if len(values) > 1 else None
    return {"accuracies": values.tolist(), "mean": float(values.mean()), "sd": spread}


def paired_differences(results: dict[str, list[float]]) -> list[dict[str, Any]]:
    """The difference of every two selections, with its interval: `a`, `b`, `mean` of b - a, `low`, `high`."""
    return [
        {
            "a": a,
            "b": b,
            **dict(zip(("mean", "low", "high"), paired_interval(results[a], results[b]), strict=True)),
        }
        for a, b in combinations(results, 2)
    ]


def paired_interval(a: Sequence[float], b: Sequence[float]) -> tuple[float, float | None, float | None]:
    """Mean of b - a and its 95 % interval, for results that share seeds pair by pair.

    Student's t on the differences: a seed moves all selections together, so that pairs tell more than means.

    Args:
        a: n results.
        b: n results of the same seeds.

    Returns:
        (mean, low, high); without an interval (None) for a single pair.
    """
    differences = np.asarray(b, np.float64) - np.asarray(a, np.float64)
    mean, n = float(differences.mean()), len(differences)
    if n < 2:
        return mean, None, None
    half = float(stats.t.ppf((1 + CONFIDENCE) / 2, n - 1) * differences.std(ddof=1) / np.sqrt(n))
    return mean, mean - half, mean + half


def _settings_of_one(config: TrainConfig, name: str, seed: int) -> TrainConfig:
    changed = {"views": name, "seed": seed, "name": None}
    if name != "learned-direct":
        changed["angles"] = "periodic"  # the form of the angles belongs to learned-direct alone
    return TrainConfig.model_validate({**config.model_dump(), **changed})


def _run_word(name: str, seed: int) -> str:
    return f"{name}-s{seed}"
