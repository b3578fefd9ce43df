"""A command line that runs in this process, in a folder of its own."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from running import Outcome
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.commands import cache as cache_command
from mvtn_cli.commands.options import Call

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder, without the caller's settings."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for name in [name for name in os.environ if name.startswith("MVTN_") and name != "MVTN_CACHE"]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(REPOSITORY), os.environ.get("PYTHONPATH")])))
    return folder


@pytest.fixture
def mvtn() -> Callable[..., Outcome]:
    """Run `mvtn WORDS...` and return exit code, stdout and stderr."""

    def run(*words: object, stdin: str | bytes | None = None) -> Outcome:
        result = CliRunner().invoke(app, [str(word) for word in words], input=stdin)
        return Outcome(result.exit_code, result.stdout, result.stderr)

    return run


@pytest.fixture
def fake_command(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Any, Call], Any]], None]:
    """Let `mvtn cache` do something else: the quickest command stands for all."""

    def replace(work: Callable[[Any, Call], Any]) -> None:
        monkeypatch.setattr(cache_command, "cache", work)

    return replace
