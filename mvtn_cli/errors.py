"""Every error that a user can cause, with its words and its exit code."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from enum import IntEnum


class ExitCode(IntEnum):
    """What the shell sees. The table in `docs/cli.md` is made from this."""

    OK = 0
    FAILED = 1
    USAGE = 2
    INTERRUPTED = 130


class MvtnError(Exception):
    """Something went wrong that the user can mend.

    Args:
        message: One sentence: what, where, what was expected.
        hint: What to do next; empty if nothing is known to help.
        code: A dotted name that scripts can match, e.g. `dataset.empty-split`.
        exit_code: What the process answers with.
    """

    def __init__(
        self, message: str, *, hint: str = "", code: str = "error", exit_code: ExitCode = ExitCode.FAILED
    ) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.code = code
        self.exit_code = exit_code


class DataError(MvtnError):
    """A file or data set that can't be used."""

    def __init__(self, message: str, *, hint: str = "", code: str = "data") -> None:
        super().__init__(message, hint=hint, code=code)


class UsageError(MvtnError):
    """A wrong option, name or combination."""

    def __init__(self, message: str, *, hint: str = "", code: str = "usage") -> None:
        super().__init__(message, hint=hint, code=code, exit_code=ExitCode.USAGE)


class Interrupted(MvtnError):
    """Ctrl-C, after everything worth keeping was saved; `hint` is how to go on."""

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message, hint=hint, code="interrupted", exit_code=ExitCode.INTERRUPTED)


def nearest(name: str, choices: Iterable[str]) -> str | None:
    """Return the choice that looks most like `name`, or None if none does."""
    close = difflib.get_close_matches(name, list(choices), n=1, cutoff=0.5)
    return close[0] if close else None


def choose_error(what: str, name: str, choices: Iterable[str]) -> UsageError:
    """Build the error for a name that is not among `choices`, with the nearest right one."""
    listed = list(choices)
    close = nearest(name, listed)
    guess = f"; did you mean '{close}'?" if close else ""
    shown = ", ".join(listed[:12]) + (", …" if len(listed) > 12 else "")
    code = f"unknown-{what.replace(' ', '-')}"
    hint = f"{what} is one of: {shown}" if listed else f"there is no {what} yet"
    return UsageError(f"unknown {what} '{name}'{guess}", hint=hint, code=code)
