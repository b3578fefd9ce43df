"""`mvtn sweep`: trainings that differ in a few settings, in one table and one plot."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.settings import usage_error
from mvtn_cli.commands.sources import open_shapes
from mvtn_cli.config import SweepConfig, TrainConfig
from mvtn_cli.console import counted, duration
from mvtn_cli.errors import UsageError, choose_error
from mvtn_cli.presets import find_preset, foreign, settings_beside

if TYPE_CHECKING:
    from mvtn_cli.core.training.sweep import Cell

NEVER = ("dataset", "name", "seed", "runs", "cache", "device", "threads", "workers")  # these are no experiment
LONGEST = 40  # characters of a value in a run's name
Wanted = dict[str, str]


def sweep(config: SweepConfig, call: Call) -> None:
    """Train with all combinations of some settings, or with one changed at a time, and put the results in one table.

    All options of mvtn train hold for all trainings. Ctrl-C saves; the same command goes on, and one with more values
    takes what is finished as it is.

    Example: mvtn sweep --vary num-views=1,3,6 --vary views=fixed,learned --seeds 3
    """
    fields, plan = list(config.varied()), plan_of(config)
    if call.dry_run:
        return _show_plan(config, plan, call)
    prepared = open_shapes(config.dataset, config, call)
    from mvtn_cli.core.training.batch_size import common_batch_size
    from mvtn_cli.core.training.sweep import Cell, sweep

    if config.batch_size is None and (config.one_at_a_time or "batch_size" not in fields):
        chosen = common_batch_size(plan.values(), prepared, call.console)
        config = config.model_copy(update={"batch_size": chosen})
        plan = plan_of(config)
    cells: list[Cell] = [Cell(word, one) for word, one in plan.items()]
    document = sweep(config.training(), cells, fields, config.seeds, prepared, call.console)
    rows = [
        [
            *(_cell(entry["settings"][field]) for field in fields),
            *(_percent(entry["accuracy"][key]) for key in ("mean", "sd")),
            _percent(entry["class_accuracy"]["mean"]),
            f"{entry['seconds']['mean']:.1f}",
            len(entry["runs"]),
        ]
        for entry in document["cells"]
    ]
    columns = [*fields, "accuracy %", "sd", "class accuracy %", "seconds", "runs"]
    call.console.table(f"test shapes of {prepared.spec}", columns, rows, stream="out")
    call.console.result({**document, "seconds": call.seconds})
    made = f"swept {counted(len(cells), 'combination')} in {duration(call.seconds)}"
    call.console.note(f"{made}; table and plot: {document['path']}/sweep.csv, .json, .svg, .png; next: mvtn eval RUN")
    return None


def plan_of(config: SweepConfig) -> dict[str, TrainConfig]:
    """The settings of each combination, by a word for its runs; combinations that come to the same come once.

    Raises:
        UsageError: A setting that can't be varied, or a value that it does not take.
    """
    varied = config.varied()
    for field in varied:
        _check_field(field)
    plan: dict[str, TrainConfig] = {}
    for wanted in _combinations(varied, one_at_a_time=config.one_at_a_time):
        one = settings_of(config, wanted)
        if one not in plan.values():
            plan[_free_word(_word(wanted), plan)] = one
    return plan


def settings_of(config: SweepConfig, wanted: Mapping[str, str]) -> TrainConfig:
    """The settings of a sweep with some of them changed; what hangs on those follows.

    Raises:
        UsageError: A value that is not taken.
    """
    said = {name: getattr(config, name) for name in config.model_fields_set if name in TrainConfig.model_fields}
    preset = find_preset(config.preset).values if config.preset else {}
    if config.batch_size is None:
        said.pop("batch_size")  # not known yet
    own = {name: value for name, value in said.items() if name not in preset or preset[name] != value}
    own = {name: value for name, value in own.items() if name not in wanted}
    own = {name: value for name, value in own.items() if name not in foreign(own, wanted)}
    values = {**own, **wanted, "name": None}
    beside = settings_beside(config.preset, values) if config.preset else {}
    try:
        return TrainConfig.model_validate({**beside, **values})
    except ValidationError as error:
        origins = dict.fromkeys(TrainConfig.model_fields, "default") | {
            name: f"--vary {name.replace('_', '-')}" for name in wanted
        }
        raise usage_error(error, TrainConfig, origins) from None
    except UsageError as error:
        told = ", ".join(f"{name.replace('_', '-')}={value}" for name, value in wanted.items())
        raise UsageError(f"{told or 'the plain settings'}: {error.message}", hint=error.hint, code=error.code) from None


def _combinations(varied: Mapping[str, list[str]], *, one_at_a_time: bool) -> Iterator[Wanted]:
    if one_at_a_time:
        yield {}
        for field, values in varied.items():
            yield from ({field: value} for value in values)
    else:
        for chosen in itertools.product(*varied.values()):
            yield dict(zip(varied, chosen, strict=True))


def _check_field(field: str) -> None:
    if field == "seed":
        raise UsageError("seeds are not varied", hint="--seeds N trains each combination N times", code="sweep.vary")
    known = [name.replace("_", "-") for name in TrainConfig.model_fields if name not in NEVER]
    if field.replace("_", "-") not in known:
        raise choose_error("setting to vary", field.replace("_", "-"), known)


def _word(wanted: Mapping[str, str]) -> str:
    """A name for a folder: `num-views-3+views-fixed`; `plain` where nothing is changed."""
    parts = [f"{field.replace('_', '-')}-{re.sub(r'[^A-Za-z0-9_.]+', '-', value)[-LONGEST:].strip('-.')}"
             for field, value in wanted.items()]  # fmt: skip
    return "+".join(parts) or "plain"


def _free_word(word: str, taken: Mapping[str, Any]) -> str:
    numbered = (word if number == 1 else f"{word}-{number}" for number in itertools.count(1))
    return next(name for name in numbered if name not in taken)


def _show_plan(config: SweepConfig, plan: Mapping[str, TrainConfig], call: Call) -> None:
    fields = list(config.varied())
    rows = [[word, *(_cell(getattr(one, field)) for field in fields)] for word, one in plan.items()]
    call.console.table("combinations", ["word", *fields], rows, stream="out")
    cells = [{"word": word, "settings": one.model_dump(mode="json", include=set(fields))} for word, one in plan.items()]
    trainings = len(plan) * config.seeds
    call.console.result({"schema": "mvtn.sweep/1", "dry_run": True, "cells": cells, "trainings": trainings})
    call.console.note(f"{counted(trainings, 'training')}; nothing was written: this was a dry run")


def _cell(value: Any) -> str:
    return "auto" if value is None else str(value)


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f}"
