"""`mvtn bench`: error against run time, measured on this machine."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.bench_config import BenchConfig
from mvtn_cli.commands.options import Call
from mvtn_cli.commands.sources import expand, names_given, open_files
from mvtn_cli.config import PreprocessConfig
from mvtn_cli.console import duration
from mvtn_cli.errors import DataError, MvtnError

if TYPE_CHECKING:
    from mvtn_cli.core.bench import Outcome, Subject

COLUMNS = {  # what people are shown; --json and --csv have all
    "gradient": ("mesh", "shading", "weights", "mode", "cosine", "G", "l2", "seconds", "truth_l2"),
    "render": (
        *("what", "mesh", "faces", "views", "shading", "supersample", "threads"),
        *("image", "forward", "backward", "seconds", "resnet", "ratio", "compile"),
    ),
    "pose": ("mesh", "faces", "light", "mode", "within_1deg", "of", "median_deg", "worst_deg", "seconds"),
    "image": ("mesh", "shading", "image_size", "supersample", "rmse", "seconds", "truth_rmse"),
    "skips": (
        *("mesh", "faces", "scene", "skip", "things", "left_out", "of", "share"),
        *("seconds", "seconds_off", "ratio", "identical", "pixels_differ"),
    ),
    "retrieval": ("what", "queries", "gallery", "dim", "classes", "seconds", "peak_mib", "map"),
    "complexity": (
        *("network", "stage", "gflops", "paper_gflops", "parameters", "paper_parameters"),
        *("seconds", "paper_ms", "peak_mib"),
    ),
    "growth": ("stage", "shapes", "cpu_seconds", "seconds", "peak_mib", "above_start", "ms_per_shape"),
    "stiff": ("code", "case", "drawn", "faces", "views", "non_finite", "seconds", "problem"),
}


def bench(config: BenchConfig, call: Call) -> None:
    """Measure how right pictures and their gradient to the cameras are, and what they cost.

    Takes minutes; --quick takes at most two. Without --mesh, built-in meshes are measured.

    Example: mvtn bench gradient --mesh chair.off table.off --plot gradient.svg
    """
    if config.compare is not None:
        return _compare(config.compare, config.files[0], call)
    from mvtn_cli.core.bench import departures, document, measure, plan_for
    from mvtn_cli.core.bench.plot import check_plot
    from mvtn_cli.core.training.device import use_threads

    if config.plot is not None:
        check_plot(config.what, config.plot)
    use_threads(config.threads)
    meshes = _open(config, call) if config.meshes else []
    plan = plan_for(
        config.what,
        quick=config.quick,
        image_size=config.image_size,
        num_views=config.num_views,
        look=config.look,
        seed=config.seed,
        queries=config.queries,
        gallery=config.gallery,
        dim=config.dim,
        networks=config.networks or None,
        sizes=config.sizes or None,
        work=config.work,
    )
    for words in departures(config.what, plan):
        call.console.note(f"reduced: {words}")
    outcome = measure(config.what, meshes, plan, call.console, threads=config.threads)
    answer = document(config.what, outcome, plan, command_words(config), call.seconds)
    _show(config.what, answer, call)
    call.console.result(answer)  # before any file that could fail: minutes of work are in it
    _write(config, outcome, call)
    call.console.note(f"measured in {duration(call.seconds)}")
    if config.what == "stiff" and outcome.summary["failed"]:
        failed = f"{outcome.summary['failed']} of {outcome.summary['cases']} stiff cases fail"
        raise MvtnError(failed, hint="the last column says how", code="bench.stiff")
    return None


def _open(config: BenchConfig, call: Call) -> list[Subject]:
    """Prepare the named files as `preprocess` would.

    Raises:
        DataError: One of them can't be used, or is a point cloud.
    """
    from mvtn_cli.core.bench import Subject

    preparing = call.settings(PreprocessConfig, "preprocess")
    prepared, failed = open_files(list(expand(names_given(config.meshes))), config.up or "y", None, preparing, call)
    if failed or prepared is None:
        raise DataError(f"{failed[0]} can't be measured", hint="leave it out, or mend it", code="files.bad")
    subjects = []
    for number, record in enumerate(prepared.records):
        shape = prepared.load(number)
        if not shape.has_mesh:
            raise DataError(f"{record.source} has no faces", hint="mvtn bench draws meshes", code="files.bad")
        subjects.append(Subject(record.name, record.source, shape, number))
    return subjects


def _show(what: str, answer: dict[str, Any], call: Call) -> None:
    columns = COLUMNS[what]
    rows = [[_cell(row.get(column)) for column in columns] for row in answer["rows"]]
    call.console.table(f"mvtn bench {what}", columns, rows, stream="out")
    for omitted in answer["omitted"]:
        call.console.note(f"omitted: {omitted['what']}: {omitted['reason']}")
    machine, load = answer["machine"], answer["machine"]["load"]
    busy = f", load {load[0]}" if load else ""
    call.console.note(f"on {machine['cpu']}, {machine['cores']} cores{busy}, torch {answer['versions']['torch']}")
    call.console.note("summary: " + ", ".join(f"{key} {_cell(value)}" for key, value in answer["summary"].items()))


def _write(config: BenchConfig, outcome: Outcome, call: Call) -> None:
    from mvtn_cli.core.bench import write_csv
    from mvtn_cli.core.bench.growth_plot import draw_growth
    from mvtn_cli.core.bench.plot import draw_plot, points_of

    if config.csv is not None:
        write_csv(config.csv, outcome.rows)
        call.console.note(f"rows: {config.csv}")
    if config.plot is not None:
        if config.what == "growth":
            draw_growth(config.plot, outcome.rows)
        else:
            points, bands, error = points_of(config.what, outcome.rows)
            draw_plot(config.plot, points, bands, error, f"mvtn bench {config.what}: error against run time")
        call.console.note(f"plot: {config.plot}")


def _compare(a: str, b: str, call: Call) -> None:
    from mvtn_cli.core.bench import compare, read_document

    documents = [read_document(Path(name)) for name in (a, b)]
    rows = compare(*documents)
    shown = [[_cell(row[key]) for key in ("row", "figure", "a", "b", "ratio")] for row in rows]
    call.console.table(f"A: {a}, B: {b}", ["row", "figure", "A", "B", "B/A"], shown, stream="out")
    for name, found in zip("AB", documents, strict=True):
        call.console.note(f"{name}: {found['command']}, on {found['machine']['cpu']}")
    call.console.result({"schema": "mvtn.bench-compare/1", "what": documents[0]["what"], "a": a, "b": b, "rows": rows})


def command_words(config: BenchConfig) -> str:
    """The command line that measures the same again."""
    words = ["mvtn", "bench", config.what]
    words += ["--mesh", *config.meshes] if config.meshes else []
    words += ["--quick"] if config.quick else []
    for name in ("up", "image_size", "num_views", "queries", "gallery", "dim", "threads"):
        value = getattr(config, name)
        words += [f"--{name.replace('_', '-')}", str(value)] if value is not None else []
    words += ["--networks", ",".join(config.networks)] if config.networks else []
    words += ["--sizes", ",".join(map(str, config.sizes))] if config.sizes else []
    words += ["--look", config.look] if config.look != "studio" else []
    return shlex.join([*words, "--seed", str(config.seed)])


def _cell(value: Any) -> str:
    """A number with as many digits as it is worth."""
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
