"""`mvtn robustness`: how runs stand shapes that are not as they were in training."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.sources import find_run, open_shapes_of
from mvtn_cli.console import counted, duration
from mvtn_cli.robustness_config import RobustnessConfig

if TYPE_CHECKING:
    from mvtn_cli.core.robustness.measure import Measured
    from mvtn_cli.core.training.run import Run

Entry = dict[str, Any]


def robustness(config: RobustnessConfig, call: Call) -> None:
    """Measure runs on test shapes that are turned, cut, noisy, thinned out or of another size.

    Asked for nothing, it measures what the paper does: turns about the up axis, and occlusion from six sides. Ctrl-C
    keeps what is finished; the same command goes on.

    Example: mvtn robustness --rotate 90,180 --occlude 0.1,0.3,0.5 --limit 500
    """
    runs = _find_runs(config, call)
    from mvtn_cli.core.robustness.files import document_of, write_files
    from mvtn_cli.core.robustness.measure import check_same_data, chosen_indices, measure
    from mvtn_cli.core.robustness.plan import plan_of
    from mvtn_cli.core.training.device import use_threads

    check_same_data(runs)
    prepared = open_shapes_of(runs[0], config, call)
    runs[0].check_classes(prepared)
    if prepared.address != runs[0].info["data_address"]:
        call.console.warn(f"{prepared.spec} is not what {runs[0].path} was trained on: the shapes have changed")
    use_threads(config.threads)
    indices, plan = chosen_indices(prepared, config.limit, config.seed), plan_of(config)
    number = counted(len(plan), "evaluation") + (" of each run" if len(runs) > 1 else "")
    call.console.note(f"{number} on {counted(len(indices), 'test shape')}, seed {config.seed}")
    measured = measure(runs, prepared, indices, plan, config, call.console)
    for one in measured[: len(measured) if len(runs) > 1 else 0]:
        write_files(one.run.path, document_of([one], prepared, indices, config), [one])
    folder = _folder(config, measured)
    document = write_files(folder, document_of(measured, prepared, indices, config), measured)
    _show(document["runs"], call)
    call.console.result({**document, "seconds": call.seconds})
    made = f"measured {counted(len(runs), 'run')} in {duration(call.seconds)}"
    call.console.note(f"{made}; table and plots: {folder / 'robustness.csv'}, .json, .svg, .png")


def _find_runs(config: RobustnessConfig, call: Call) -> list[Run]:
    """The runs that were named, each once, else the latest."""
    if not config.run:
        return [find_run(None, config.runs, call)]
    found = [find_run(name, config.runs, call) for name in config.run]
    return list({run.path.resolve(): run for run in found}.values())


def _folder(config: RobustnessConfig, measured: Sequence[Measured]) -> Path:
    if config.out is not None:
        return config.out
    return measured[0].run.path if len(measured) == 1 else config.runs / "robustness"


def _show(runs: Sequence[Entry], call: Call) -> None:
    if len(runs) == 1:
        _show_one(runs[0], call)
    else:
        _show_several(runs, call)
    occluded = [(run, entry) for run in runs for entry in run["corruptions"] if entry["kind"] == "occlude"]
    if occluded:
        directions = list(occluded[0][1]["by"])
        rows = [
            [run["name"], f"{entry['strength']:g}", *(_percent(entry["by"][name]) for name in directions)]
            for run, entry in occluded
        ]
        title = "accuracy % by the side that is taken away"
        call.console.table(title, ["run", "share", *directions], rows, stream="out")


def _show_one(run: Entry, call: Call) -> None:
    """One run: a row a corruption."""
    rows = [["clean", _percent(run["clean"]["accuracy"]), "", "", "", "", ""]]
    rows += [
        [
            _name(entry),
            _percent(entry["mean"]),
            _percent(entry["sd"]),
            _percent(entry["low"]),
            _percent(entry["high"]),
            f"{100 * entry['difference']['mean']:+.1f}",
            _percent(entry["points_left"]),
        ]
        for entry in run["corruptions"]
    ]
    columns = ["corruption", "accuracy %", "sd", "lowest", "highest", "to clean", "points left %"]
    call.console.table(f"{run['run']}: test shapes, corrupted", columns, rows, stream="out")


def _show_several(runs: Sequence[Entry], call: Call) -> None:
    """The paper's table: a row a run, a column a corruption."""
    columns = ["run", "clean", *(_name(entry) for entry in runs[0]["corruptions"])]
    rows = [
        [run["name"], _percent(run["clean"]["accuracy"]), *(_with_sd(entry) for entry in run["corruptions"])]
        for run in runs
    ]
    call.console.table("accuracy %, mean ± sd", columns, rows, stream="out")


def _name(entry: Entry) -> str:
    return entry["kind"] if entry["kind"] == "so3" else f"{entry['kind']} {entry['strength']:g}"


def _with_sd(entry: Entry) -> str:
    mean = _percent(entry["mean"])
    return mean if entry["sd"] is None else f"{mean} ± {_percent(entry['sd'])}"


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f}"
