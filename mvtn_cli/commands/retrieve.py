"""`mvtn retrieve`: how well shapes find their like, or what is like a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.sources import (
    expand,
    find_run,
    judge_bad_files,
    names_given,
    open_files,
    open_shapes_of,
    up_axis,
)
from mvtn_cli.console import counted, duration
from mvtn_cli.retrieve_config import RetrieveConfig

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.retrieval.query import Finder
    from mvtn_cli.core.training.run import Run

WORDS = {"ap": "mAP", "ap_printed": "mAP as printed", "ndcg": "NDCG"}
FILES_AT_ONCE = 16  # that are prepared before the first of them is answered


def retrieve(config: RetrieveConfig, call: Call) -> None:
    """Measure how well the shapes of a run find their like, or with --query find what is like a file.

    Example: mvtn retrieve --query chair.obj --top 10
    """
    from mvtn_cli.core.retrieval.index import require
    from mvtn_cli.core.training.device import use_threads

    require(config.index)
    files = list(expand(names_given(config.query))) if config.query else []
    run = find_run(config.run, config.runs, call)
    use_threads(config.threads)
    prepared = open_shapes_of(run, config, call)
    if prepared.address != run.info["data_address"]:
        call.console.warn(f"{prepared.spec} is not what {run.path} was trained on: the shapes have changed")
    if files:
        _search(files, run, prepared, config, call)
    else:
        _measure(run, prepared, config, call)


def _measure(run: Run, prepared: Prepared, config: RetrieveConfig, call: Call) -> None:
    from mvtn_cli.core.retrieval.retrieve import retrieve_run

    result = retrieve_run(run, prepared, config, call.console)
    names = list(result["micro"])
    kinds = ["micro", "macro", *(["mean"] if "mean" in result else [])]
    rows = [[_word(name), *(_percent(result[kind][name]) for kind in kinds)] for name in names]
    title = f"{run.path}: {result['split']} searches {result['gallery']['split']}, {config.checkpoint} weights"
    call.console.table(title, ["measure", *(f"{kind} %" for kind in kinds)], rows, stream="out")
    if left_out := result.get("left_out"):
        call.console.warn(f"{left_out} queries are left out: no shape of their class is searched")
    if "recall" in result["index"]:
        share = _percent(result["index"]["recall"])
        whole = "; the measures are of the whole, exact ranking" if config.protocol == "paper" else ""
        call.console.note(f"{config.index} finds {share} % of the exact hits{whole}")
    call.console.result(result)
    shapes = f"{counted(result['gallery']['count'], 'shape')} searched for {result['queries']}"
    made = f"{shapes} in {duration(call.seconds)}; files: {result['folder']}"
    call.console.note(f"{made}; next: mvtn retrieve --query FILE")


def _search(files: Sequence[str], run: Run, prepared: Prepared, config: RetrieveConfig, call: Call) -> None:
    from mvtn_cli.core.retrieval.query import Finder
    from mvtn_cli.core.retrieval.searchable import open_searchable

    bad: list[str] = []
    up = up_axis(config.up, run)
    opened = _opened(files, up, run, config, call, bad)
    first = next(opened, None)  # before minutes of work on the training shapes
    if first is not None:
        finder = Finder(open_searchable(run, prepared, config, call.console), config, config.out or Path("retrieved"))
        for part, names in (first, *opened):
            _answer(finder, part, names, call)
    call.console.result(
        {"schema": "mvtn.retrieve-query/1", "run": str(run.path), "bad": len(bad), "seconds": call.seconds},
        records="queries",
    )
    judge_bad_files(len(bad), len(files), config.on_bad)
    found = f"{counted(len(files) - len(bad), 'file')} looked up in {duration(call.seconds)}"
    call.console.note(f"{found}; pictures: {config.out or 'retrieved'}")


def _opened(
    files: Sequence[str], up: str, run: Run, config: RetrieveConfig, call: Call, bad: list[str]
) -> Iterator[tuple[Prepared, list[str]]]:
    """Prepare some files at a time; those that can't be used are added to `bad`."""
    for begin in range(0, len(files), FILES_AT_ONCE):
        batch = files[begin : begin + FILES_AT_ONCE]
        part, failed = open_files(batch, up, run, config, call)
        bad += failed
        if part is not None:
            called = {str(Path(file).absolute()): file for file in batch}
            yield part, [called[record.source] for record in part.records]


def _answer(finder: Finder, part: Prepared, names: Sequence[str], call: Call) -> None:
    for answer in finder.find(part, names):
        lines = [
            "\t".join([answer["query"], str(hit["rank"]), hit["class"], f"{hit['distance']:.6g}", hit["name"]])
            for hit in answer["hits"]
        ]
        call.console.record(answer, "\n".join(lines))


def _word(name: str) -> str:
    return WORDS.get(name) or (name if name == "mAP" else name[0].upper() + name[1:])


def _percent(share: Any) -> str:
    return f"{100 * share:.1f}"
