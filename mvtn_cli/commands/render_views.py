"""`mvtn render-views`: what the cameras see."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.sources import (
    expand,
    find_run,
    judge_bad_files,
    names_given,
    open_files,
    open_shapes,
    open_shapes_of,
    up_axis,
)
from mvtn_cli.console import counted, duration
from mvtn_cli.errors import Interrupted
from mvtn_cli.render_views_config import RenderViewsConfig

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.run import Run

FILES_AT_ONCE = 16  # that are prepared before the first of them is drawn


@dataclass
class Work:
    """What is to be drawn.

    Attributes:
        parts: One after another; files are prepared when their turn comes.
        total: How many shapes; None where `parts` says it.
        bad: Files that can't be used, as far as they are known.
    """

    parts: Any
    total: int | None = None
    bad: list[str] = field(default_factory=list)


def render_views(config: RenderViewsConfig, call: Call) -> None:
    """Draw what cameras see of shapes: files, a data set, or the shapes of a run from where it put its cameras.

    Example: mvtn render-views chair.off --layout circular --num-views 12 --outputs depth,normals
    """
    from mvtn_cli.core.reporting import render_views as draw

    words, run = _sort(config, call)
    config = config.model_copy(update={"run": str(run.path) if run else None, "files": words})
    work = _open(words, run, config, call)
    made = 0
    try:
        for answer in draw(work.parts, config, call.console, total=work.total):
            if "error" in answer:
                work.bad.append(answer["file"])
                continue
            made += 1
            call.console.record(answer, f"{answer['file']}\t{answer['picture']}")
    except KeyboardInterrupt:
        raise Interrupted(
            f"interrupted; the pictures of {counted(made, 'shape')} are in {config.out}",
            hint="the same command draws all of them again",
        ) from None
    call.console.result(
        {
            "schema": "mvtn.render-views/1",
            "run": config.run,
            "bad": len(work.bad),
            "seconds": call.seconds,
        },
        records="pictures",
    )
    judge_bad_files(len(work.bad), len(work.bad) + made, config.on_bad)
    call.console.note(f"views of {counted(made, 'shape')} in {config.out}, {duration(call.seconds)}")


def _sort(config: RenderViewsConfig, call: Call) -> tuple[tuple[str, ...], Run | None]:
    """Tell a run among the words from files and data sets, and find the run whose cameras are wanted."""
    words = config.files
    if len(words) == 1 and config.run is None and _is_run(words[0], config.runs):
        return (), find_run(words[0], config.runs, call)
    wanted = config.run is not None or config.asks_a_network
    return words, find_run(config.run, config.runs, call) if wanted else None


def _is_run(word: str, runs: Path) -> bool:
    return any((folder / "run.json").is_file() for folder in (Path(word), runs / word))


def _open(words: tuple[str, ...], run: Run | None, config: RenderViewsConfig, call: Call) -> Work:
    """Find what is to be drawn."""
    if not words:
        return Work([open_shapes_of(run, config, call) if run else open_shapes(None, config, call)])
    if len(words) == 1 and words[0] != "-" and (Path(words[0]).is_dir() or _is_spec(words[0])):
        return Work([open_shapes(words[0], config, call)])
    files = list(expand(names_given(words)))
    work = Work(None, len(files))
    work.parts = _parts(files, run, config, call, work.bad)
    return work


def _parts(
    files: Sequence[str], run: Run | None, config: RenderViewsConfig, call: Call, bad: list[str]
) -> Iterator[Prepared]:
    """Prepare some files at a time, so that pictures of the first come before the last is read.

    Names are made from all files, so that they do not depend on which ones are prepared together.
    """
    from mvtn_cli.core.datasets import unlabelled

    up, there = up_axis(config.up, run), [file for file in files if Path(file).is_file()]
    names = {item.source: item.name for item in unlabelled(there).items} if there else {}
    for begin in range(0, len(files), FILES_AT_ONCE):
        prepared, failed = open_files(files[begin : begin + FILES_AT_ONCE], up, run, config, call)
        bad += failed
        if prepared is not None:
            named = tuple(replace(record, name=names[record.source]) for record in prepared.records)
            yield replace(prepared, records=named)


def _is_spec(word: str) -> bool:
    """Whether a word is a data set such as `builtin:shapes`, not a file (nor a drive letter)."""
    return not Path(word).exists() and len(word.partition(":")[0]) > 1 and ":" in word
