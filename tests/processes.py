"""The command line as a user has it: processes of their own, in a folder of their own."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pytest
from filelock import FileLock

REPOSITORY = Path(__file__).resolve().parent.parent
PATIENCE = 180  # seconds: on a new machine the first picture waits for the compiler

Made = TypeVar("Made")


@dataclass(frozen=True)
class Ended:
    """What a process left behind."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> Any:
        """The one JSON document on stdout."""
        return json.loads(self.out)

    @property
    def lines(self) -> list[Any]:
        """The JSON documents on stdout, one a line."""
        return [json.loads(line) for line in self.out.splitlines()]

    @property
    def error(self) -> tuple[str, str]:
        """The one sentence of the error, and the hint below it, which end a stderr without traceback."""
        assert "Traceback" not in self.err, self.err
        *_, last = self.err.split("error: ")
        message, _, hint = last.rstrip("\n").partition("\n  ")
        assert self.err.count("error: ") == 1 and message and "\n" not in message + hint, self.err
        return message, hint


@dataclass(frozen=True)
class Folder:
    """A working folder with an artifact directory of its own beside it.

    Attributes:
        path: Where it is.
    """

    path: Path

    @property
    def cache(self) -> Path:
        """Its artifact directory."""
        return self.path.parent / f"{self.path.name}.cache"

    def start(self, *command: object, **options: Any) -> subprocess.Popen[bytes]:
        """Start a command in the folder; `mvtn` and `python` are those under test."""
        program, *words = map(str, command)
        known = {"mvtn": [sys.executable, "-m", "mvtn_cli"], "python": [sys.executable]}
        self.path.mkdir(parents=True, exist_ok=True)
        return subprocess.Popen(
            [*known.get(program, [program]), *words],
            cwd=self.path,
            env=environment(MVTN_CACHE=str(self.cache), **options.pop("variables", {})),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            **options,
        )

    def run(self, *command: object, stdin: bytes = b"", variables: Mapping[str, str] | None = None) -> Ended:
        """Run a command in the folder to its end."""
        return finish(self.start(*command, variables=dict(variables or {})), stdin)

    def mvtn(self, *words: object, stdin: bytes = b"", **variables: str) -> Ended:
        """Run `mvtn WORDS...` in the folder to its end."""
        return self.run("mvtn", *words, stdin=stdin, variables=variables)


def finish(process: subprocess.Popen[bytes], stdin: bytes = b"") -> Ended:
    """Wait for the end of a process; one that hangs is killed."""
    try:
        out, err = process.communicate(stdin, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        raise
    return Ended(process.returncode, out.decode(), err.decode())


def environment(**more: str) -> dict[str, str]:
    """This process's environment without the caller's settings; one thread, as pictures are tiny."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("MVTN_")}
    path = os.pathsep.join(filter(None, [str(REPOSITORY), own.get("PYTHONPATH")]))
    return own | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"} | more


def once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], Made]) -> Made:
    """Make something dear a single time, also where several processes share the tests (pytest-xdist).

    Args:
        factory: Of pytest; its base folder belongs to this test run.
        name: What is made, a file name.
        make: Gets a folder and gives back something that can be pickled.
    """
    base = factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    kept = base / f"{name}.pickle"
    with FileLock(f"{kept}.lock"):
        if not kept.exists():
            kept.write_bytes(pickle.dumps(make(base / name)))
        return pickle.loads(kept.read_bytes())
