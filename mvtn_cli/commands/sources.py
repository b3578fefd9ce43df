"""What a command works on: which files, which data set, which run. What was taken unasked is said."""

from __future__ import annotations

import glob
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.settings import resolve
from mvtn_cli.config import PreprocessConfig
from mvtn_cli.console import Console
from mvtn_cli.errors import DataError, UsageError

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.run import Run


def names_given(words: Sequence[str]) -> list[str]:
    """Replace each `-` among file names by the names on standard input.

    Raises:
        UsageError: There are none.
    """
    names: list[str] = []
    for word in words:
        names += _names_on_stdin() if word == "-" else [word]
    if not names:
        raise UsageError(
            "no file was given",
            hint="name meshes or point clouds, or give - and their names on standard input",
            code="files.none",
        )
    return names


def _names_on_stdin() -> list[str]:
    """Names from standard input: NUL-separated where there is a NUL, else one a line."""
    data = b"" if sys.stdin is None or sys.stdin.isatty() else sys.stdin.buffer.read()
    parts = data.split(b"\0") if b"\0" in data else data.splitlines()
    names = [os.fsdecode(part) for part in parts if part.strip()]
    if not names:
        raise UsageError(
            "standard input names no files",
            hint="one name a line, or NUL-separated, as from find . -name '*.off' -print0",
            code="files.none",
        )
    return names


def expand(names: Sequence[str]) -> Iterator[str]:
    """Replace folders by the shape files in them and patterns by what they match; each file comes once."""
    seen: set[Path] = set()
    for name in names:
        for file in _expand_one(name):
            path = Path(file).absolute()
            if path not in seen:
                seen.add(path)
                yield file


def _expand_one(name: str) -> list[str]:
    from mvtn_cli.core.shapes import SUFFIXES

    pattern = glob.has_magic(name) and not os.path.exists(name)
    if not pattern and not os.path.isdir(name):
        return [name]
    found = glob.glob(name, recursive=True) if pattern else map(str, Path(name).rglob("*"))
    files = sorted(path for path in found if Path(path).suffix.lower() in SUFFIXES and os.path.isfile(path))
    if not files:
        raise DataError(
            f"{name} {'matches' if pattern else 'holds'} no shape file",
            hint=f"readable are {' '.join(sorted(SUFFIXES))}",
            code="files.none",
        )
    return files


def open_shapes_of(run: Run, config: Any, call: Call) -> Prepared:
    """Open the shapes that a run was trained on, prepared as they were then."""
    from mvtn_cli.core.preprocess import Settings, open_prepared

    settings = Settings.from_dict(run.info["preprocess"])
    return open_prepared(run.info["dataset"], config, call.console, settings=settings)


def open_shapes(spec: str | None, config: Any, call: Call) -> Prepared:
    """Open the stored shapes of a data set; without a name, that of mvtn.toml or this folder's last work.

    Settings of `preprocess` in the file hold here, too, so that both commands mean the same shapes.
    """
    from mvtn_cli.core.preprocess import open_prepared

    wanted, origins = resolve(PreprocessConfig, {}, call.config_file, "preprocess")
    own = [name for name in ("max_vertices", "num_points") if origins[name] != "default"]
    if own or origins["seed"].endswith("[preprocess]"):
        config = wanted.model_copy(update={"cache": config.cache, "workers": config.workers})
    return open_prepared(spec or wanted.dataset, config, call.console)


def find_run(name: str | None, runs: Path, call: Call) -> Run:
    """Open the run of this name or folder, else the latest, and say which."""
    from mvtn_cli.core.training.run import Run

    if name is not None:
        return Run.open(name, runs)
    run = Run.latest(runs)
    call.console.note(f"run: {run.path} (the latest)")
    return run


def open_files(
    files: Sequence[str], up: str, run: Run | None, config: Any, call: Call
) -> tuple[Prepared | None, list[str]]:
    """Prepare single files; those that can't be used are named on stderr and don't stop the others.

    Args:
        files: Names; each may be missing.
        up: The axis that points up in them, `y` or `z`.
        run: Whose shapes they are to be prepared like; None is as `preprocess` would.
        config: The command's configuration: `cache` and `workers` hold.
        call: For the settings of `preprocess` and the console.

    Returns:
        The usable ones (None if there are none) and the names of the others.
    """
    from mvtn_cli.core.datasets import unlabelled
    from mvtn_cli.core.preprocess import Settings, prepare
    from mvtn_cli.core.store import Store, cache_root

    failed = {file: "no such file" for file in files if not Path(file).is_file()}
    present = {str(Path(file).absolute()): file for file in files if file not in failed}
    prepared = None
    if present:
        wanted = Settings.of(call.settings(PreprocessConfig, "preprocess"))
        settings = Settings.from_dict(run.info["preprocess"]) if run else wanted
        quiet = Console(err=call.console.err, quiet=True)
        store = Store(cache_root(config.cache))
        dataset = unlabelled(list(present), up=up)
        prepared, summary = prepare(dataset, settings, store, quiet, workers=config.workers, remember=False)
        for finding in summary.findings:
            if finding["fatal"]:
                failed.setdefault(present[finding["file"]], finding["finding"])
    for file, reason in failed.items():
        call.console.warn(f"{file}: {reason}")
    return (prepared if prepared and len(prepared) else None), list(failed)


def judge_bad_files(bad: int, total: int, on_bad: str) -> None:
    """End with an error if bad files count as one.

    Raises:
        DataError: There are bad files and `on_bad` is `fail`.
    """
    if bad and on_bad == "fail":
        hint = "the others were answered; with --on-bad skip this is a success" if bad < total else ""
        raise DataError(f"{bad} of {total} files can't be used", hint=hint, code="files.bad")


def up_axis(wanted: str | None, run: Run | None) -> str:
    """The axis that points up in single files: as asked, else as in the data set of the run."""
    return wanted or ("z" if run and ", z up" in run.info["title"] else "y")
