"""Ctrl-C: the first ends after this step and saves, the second ends now."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from types import FrameType, TracebackType
from typing import Any

from mvtn_cli.console import Console


class StopNow(Exception):
    """Raised between two batches of an evaluation when a stop was asked for."""


class StopRequest:
    """Whether someone wants the training to end: Ctrl-C, a terminate signal, or the caller's own question.

    As a context manager it takes over SIGINT and SIGTERM; outside the main thread it leaves them alone.

    Args:
        console: Where the first signal is acknowledged.
        also: The caller's question, asked after each step.
    """

    def __init__(self, console: Console, also: Callable[[], bool] | None = None) -> None:
        self._console = console
        self._also = also
        self._asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> StopRequest:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, kind: type[BaseException] | None, value: Any, trace: TracebackType | None) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()

    def __call__(self) -> bool:
        """Whether to stop after this step."""
        if self._also is not None and self._also():
            self._asked = True
        return self._asked

    @property
    def asked(self) -> bool:
        """Whether a signal has come, or the caller has said yes before (it is asked after steps alone)."""
        return self._asked

    def check(self) -> None:
        """Raise StopNow if so."""
        if self._asked:
            raise StopNow

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
        with suppress(RuntimeError):  # the signal may have come in the middle of writing to the same stream
            self._console.note("stopping after this step; once more to end now without saving")
