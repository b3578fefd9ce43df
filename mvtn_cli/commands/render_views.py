"""`mvtn render-views`: what the cameras see."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

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
from mvtn_cli.config import RenderViewsConfig
from mvtn_cli.console import counted, duration

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.run import Run


def render_views(config: RenderViewsConfig, call: Call) -> None:
    """Draw the views of shapes, one PNG each: files, a data set, or what a run's cameras see of its shapes.

    Example: mvtn render-views chair.off --layout circular --num-views 12
    """
    from mvtn_cli.core.reporting import render_views as draw

    words, run = _sort(config, call)
    config = config.model_copy(update={"run": str(run.path) if run else None, "files": words})
    prepared, bad = _open(words, run, config, call)
    made = 0
    if prepared is not None:
        for answer in draw(prepared, config, call.console):
            made += 1
            call.console.record(answer, f"{answer['file']}\t{answer['picture']}")
    call.console.result(
        {
            "schema": "mvtn.render-views/1",
            "run": config.run,
            "bad": bad,
            "seconds": call.seconds,
        },
        records="pictures",
    )
    judge_bad_files(bad, bad + made, config.on_bad)
    call.console.note(f"{counted(made, 'picture')} in {config.out}, {duration(call.seconds)}")


def _sort(config: RenderViewsConfig, call: Call) -> tuple[tuple[str, ...], Run | None]:
    """Tell a run among the words from files and data sets, and find the run whose cameras are wanted."""
    words = config.files
    if len(words) == 1 and config.run is None and _is_run(words[0], config.runs):
        return (), find_run(words[0], config.runs, call)
    learned = config.views is not None and config.views.startswith("learned")
    wanted = config.run is not None or learned
    return words, find_run(config.run, config.runs, call) if wanted else None


def _is_run(word: str, runs: Path) -> bool:
    return any((folder / "run.json").is_file() for folder in (Path(word), runs / word))


def _open(
    words: tuple[str, ...], run: Run | None, config: RenderViewsConfig, call: Call
) -> tuple[Prepared | None, int]:
    """Open what is to be drawn; returns it (None if nothing can be used) and how many files are bad."""
    if not words:
        return (open_shapes_of(run, config, call) if run else open_shapes(None, config, call)), 0
    if len(words) == 1 and words[0] != "-" and (Path(words[0]).is_dir() or _is_spec(words[0])):
        return open_shapes(words[0], config, call), 0
    prepared, failed = open_files(list(expand(names_given(words))), up_axis(config.up, run), run, config, call)
    return prepared, len(failed)


def _is_spec(word: str) -> bool:
    """Whether a word is a data set such as `builtin:shapes`, not a file (nor a drive letter)."""
    return not Path(word).exists() and len(word.partition(":")[0]) > 1 and ":" in word
