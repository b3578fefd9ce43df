"""Where words go: answers to stdout, everything said to a person to stderr.

One object carries the two streams and the output mode through every room, so that a test can replace it
and no function of core ever prints.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TextIO

if TYPE_CHECKING:  # rich costs 40 ms, which `mvtn --help` and pipes need not pay
    from rich.console import Console as RichConsole
    from rich.progress import Progress

NARROW = 80  # characters
Mode = Literal["text", "json", "jsonl"]


class PipeClosed(BrokenPipeError):
    """The reader of our stdout or stderr has gone; a worker's broken pipe is another matter, and an error."""


class Ticker:
    """Counts finished pieces of a long work; this one says nothing."""

    def advance(self, n: int = 1) -> None:
        """Count `n` more finished pieces."""

    def note(self, text: str) -> None:
        """Show `text` (a loss, a file name) beside the count."""


class BarTicker(Ticker):
    """A rich progress bar, for a person at a terminal."""

    def __init__(self, bar: Progress, description: str, total: int | None) -> None:
        self._bar = bar
        self._task = bar.add_task(description, total=total, note="", rate="")

    def advance(self, n: int = 1) -> None:
        self._bar.advance(self._task, n)
        speed = self._bar.tasks[self._task].speed
        if speed:
            self._bar.update(self._task, rate=f"{_number(speed)}/s")

    def note(self, text: str) -> None:
        self._bar.update(self._task, note=text)


class LineTicker(Ticker):
    """A line now and then, for a log file."""

    INTERVAL = 30.0  # seconds

    def __init__(self, console: Console, description: str, total: int | None) -> None:
        self._console = console
        self._description = description
        self._total = total
        self._done = 0
        self._note = ""
        self._start = self._last = console.clock()

    def advance(self, n: int = 1) -> None:
        self._done += n
        now = self._console.clock()
        if now - self._last >= self.INTERVAL:
            self._last = now
            self._console.note(self._line(now - self._start))

    def note(self, text: str) -> None:
        self._note = text

    def _line(self, elapsed: float) -> str:
        rate = self._done / elapsed
        parts = [f"{self._done}", f"{_number(rate)}/s"]
        if self._total:
            parts[0] = f"{self._done}/{self._total} ({100 * self._done // self._total} %)"
            parts += [f"{duration((self._total - self._done) / rate)} left"] if rate else []
        return f"{self._description}: " + ", ".join(parts + [self._note] * bool(self._note))


class Console:
    """The two streams of a command and the form of its answer.

    Args:
        out: Where answers go; stdout as it is at this moment if None.
        err: Where narration, warnings and progress go; stderr if None.
        mode: `text` for people and pipes, `json` for one document, `jsonl` for one object a line.
        quiet: Leave out narration, tables and progress on `err`; warnings stay.
        debug: Show tracebacks.
    """

    def __init__(
        self,
        out: TextIO | None = None,
        err: TextIO | None = None,
        mode: Mode = "text",
        quiet: bool = False,
        debug: bool = False,
    ) -> None:
        self.out = sys.stdout if out is None else out
        self.err = sys.stderr if err is None else err
        self.mode = mode
        self.quiet = quiet
        self.debug = debug
        self.warnings: list[str] = []
        self.records: list[dict[str, Any]] = []
        self.clock = time.monotonic
        self._rich: dict[str, RichConsole] = {}
        self._bars = 0  # that are on the screen now

    def note(self, text: str) -> None:
        """Say `text` to the person watching."""
        if not self.quiet:
            self._say(text)

    def warn(self, text: str) -> None:
        """Say that something may not be as the user thinks; kept for the JSON document."""
        self.warnings.append(text)
        self._say(f"warning: {text}")

    def record(self, record: Mapping[str, Any], text: str) -> None:
        """Give one of many answers as it becomes known.

        Args:
            record: The answer for programs: a line in `jsonl` mode, kept for `result` in `json` mode.
            text: The answer for people.
        """
        self.records.append(dict(record))
        if self.mode == "jsonl":
            self._answer(dumps(record))
        elif self.mode == "text":
            self._answer(text)

    def result(self, document: Mapping[str, Any], text: str = "", *, records: str = "") -> None:
        """Give the final answer, once a command.

        `json` mode prints the document with the warnings and, under the key that `records` names, what was
        recorded; `jsonl` mode prints it on one line, or nothing if the records were the answer already;
        `text` mode prints `text`, if there is any.
        """
        whole = {**document, "warnings": self.warnings}
        if self.mode == "json":
            self._answer(dumps(whole | ({records: self.records} if records else {}), indent=2))
        elif self.mode == "jsonl":
            if not records:
                self._answer(dumps(whole))
        elif text:
            self._answer(text)

    def table(
        self,
        title: str,
        columns: Sequence[str],
        rows: Sequence[Sequence[object]],
        *,
        stream: Literal["err", "out"] = "err",
    ) -> None:
        """Show rows: ruled on a terminal, tab-separated in a pipe.

        On `out` it is an answer and gives way to the document in the JSON modes; on `err` it is narration.
        """
        if (stream == "out" and self.mode != "text") or (stream == "err" and self.quiet):
            return
        if self.is_terminal(stream):
            self._rich_console(stream).print(_rich_table(title, columns, rows))
            return
        lines = ["\t".join(columns), *("\t".join(_cell(cell) for cell in row) for row in rows)]
        if stream == "err":
            lines.insert(0, title)
        self._write(self._stream(stream), "\n".join(lines))

    @contextmanager
    def progress(self, description: str, total: int | None = None) -> Iterator[Ticker]:
        """Show how far a long work is: a bar on a terminal, else a line every 30 s; nothing when quiet."""
        if self.quiet:
            yield Ticker()
        elif self.is_terminal("err"):
            with _rich_bar(self._rich_console("err")) as bar:
                self._bars += 1
                try:
                    yield BarTicker(bar, description, total)
                finally:
                    self._bars -= 1
        else:
            yield LineTicker(self, description, total)

    def is_terminal(self, stream: Literal["err", "out"]) -> bool:
        """Whether a person reads this stream and it can be drawn on."""
        return self._stream(stream).isatty() and os.environ.get("TERM") != "dumb"

    def _stream(self, stream: Literal["err", "out"]) -> TextIO:
        return self.out if stream == "out" else self.err

    def _say(self, text: str) -> None:
        if self.is_terminal("err"):  # through rich, so that a running bar stays in one piece
            self._rich_console("err").print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            self._write(self.err, text)

    def _answer(self, text: str) -> None:
        if self._bars and self.is_terminal("out"):
            self._say(text)  # both streams are the same screen: above the bar, not through it
        else:
            self._write(self.out, text)

    @staticmethod
    def _write(stream: TextIO, text: str) -> None:
        """Write a line now: a reader at the other end of a pipe wants it before the work ends."""
        encoding = getattr(stream, "encoding", None) or "utf-8"
        try:
            stream.write(text.encode(encoding, "backslashreplace").decode(encoding) + "\n")
            stream.flush()
        except BrokenPipeError:
            raise PipeClosed from None

    def _rich_console(self, stream: Literal["err", "out"]) -> RichConsole:
        if stream not in self._rich:
            from rich.console import Console as RichConsole

            self._rich[stream] = RichConsole(file=self._stream(stream))
        return self._rich[stream]


def help_style() -> Literal["rich", None]:
    """How typer shows help: in panels, or as plain text where those would cut the names of options short."""
    return "rich" if shutil.get_terminal_size().columns >= NARROW else None


def close_pipes() -> None:
    """Point streams whose reader has gone at nothing, so that Python does not complain when it ends."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def dumps(document: Any, indent: int | None = None) -> str:
    """Turn a document into strict JSON: NaN and infinities become null, arrays lists, paths strings."""
    return json.dumps(plain(document), indent=indent, allow_nan=False, ensure_ascii=False)


def plain(value: Any) -> Any:
    """Reduce a value to what JSON knows. Arrays are told by their `tolist`, so that numpy stays out."""
    if value is None or isinstance(value, bool | str):
        return str(value) if isinstance(value, str) else value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    raise TypeError(f"{type(value).__name__} can't be written as JSON")


def duration(seconds: float) -> str:
    """Say a time span the way people do: `0.4 s`, `42 s`, `4 min 12 s`, `2 h 5 min`."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def counted(number: int, noun: str) -> str:
    """Say `1 file` or `3 files`."""
    return f"{number} {noun}" + "s" * (number != 1)


def _number(rate: float) -> str:
    return f"{rate:.1f}" if rate < 100 else f"{rate:.0f}"


def _cell(value: object) -> str:
    """One cell of a pipe's table: tabs and line breaks would split it."""
    return " ".join(str(value).split()) if isinstance(value, str) else str(value)


def _rich_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title, title_justify="left")
    for index, column in enumerate(columns):
        numeric = bool(rows) and all(_is_number(row[index]) for row in rows)
        table.add_column(column, justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(str(cell)) for cell in row))
    return table


def _is_number(cell: object) -> bool:
    if cell == "":
        return True
    try:
        float(str(cell).rstrip(" %°s"))
    except ValueError:
        return False
    return True


def _rich_bar(console: RichConsole) -> Progress:
    from rich import progress as bars

    return bars.Progress(
        bars.TextColumn("{task.description}"),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TextColumn("{task.fields[rate]}"),
        bars.TimeRemainingColumn(),
        bars.TextColumn("{task.fields[note]}"),
        console=console,
        transient=True,
    )
