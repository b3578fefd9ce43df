"""Text files as rows of tokens, with the line each came from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain, takewhile
from pathlib import Path

import numpy as np

from mvtn_cli.core.shapes.shape import FloatArray
from mvtn_cli.core.shapes.source import quoted, unreadable
from mvtn_cli.errors import DataError


class Rows:
    """The lines of a text file that say something, split at blanks, with their line numbers."""

    def __init__(self, path: Path, tokens: list[list[bytes]], lines: Sequence[int]) -> None:
        self.path, self.tokens, self.lines = path, tokens, lines

    @classmethod
    def parse(cls, path: Path, data: bytes, comment: bytes = b"#") -> Rows:
        """Split text into rows, without blank lines and without what follows a word that begins a comment."""
        tokens, lines = [], []
        for number, line in enumerate(data.splitlines(), 1):
            row = line.split()
            if comment in line:  # only at a word's beginning: `1.#IND` is a bad number, not 1
                row = list(takewhile(lambda token: not token.startswith(comment), row))
            if row:
                tokens.append(row)
                lines.append(number)
        return cls(path, tokens, lines)

    def __len__(self) -> int:
        return len(self.tokens)

    def __getitem__(self, part: slice) -> Rows:
        return Rows(self.path, self.tokens[part], self.lines[part])

    def numbers(self, what: str, least: int) -> FloatArray:
        """Return (rows, width) float64; all rows must be as long as the first, and have at least `least`."""
        width = len(self.tokens[0]) if self.tokens else least
        if any(len(row) != width for row in self.tokens) or width < least:
            wanted = max(width, least)
            at = next(i for i, row in enumerate(self.tokens) if len(row) != wanted)
            raise self.error(at, f"{what} has {len(self.tokens[at])} numbers", expected=f"{wanted}")
        try:
            flat = floats(chain.from_iterable(self.tokens), len(self) * width)
        except ValueError:
            at, token = next((i, t) for i, row in enumerate(self.tokens) for t in row if not is_float(t))
            raise self.error(at, f"{quoted(token)} is not a number", expected=f"{what}") from None
        return flat.reshape(-1, width)

    def error(self, at: int, what: str, *, expected: str = "") -> DataError:
        """Build the error for row `at`."""
        return unreadable(self.path, what, expected=expected, line=self.lines[at])


def floats(tokens: Iterable[bytes], count: int) -> FloatArray:
    """Parse tokens to float64. ValueError if one is no number."""
    return np.fromiter(map(float, tokens), np.float64, count)


def is_float(token: bytes) -> bool:
    """Whether `float` takes this token."""
    try:
        float(token)
    except ValueError:
        return False
    return True


def is_int(token: bytes) -> bool:
    """Whether this token is an integer of a size that an index can have."""
    try:
        return abs(int(token)) < 2**63
    except ValueError:
        return False
