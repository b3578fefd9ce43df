"""A fixture that several rooms share: import it into a room's conftest."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from mvtn_cli.core.bench.timing import threads


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Pictures of 16 pixels are not worth a second thread."""
    with threads(1):
        yield
