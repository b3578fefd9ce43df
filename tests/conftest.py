"""Fixtures that every room shares."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

# A suite that is started in the background inherits "ignore Ctrl-C", and so would every process that a test starts.
signal.signal(signal.SIGINT, signal.default_int_handler)

REPOSITORY = Path(__file__).resolve().parent.parent


def data_folder() -> Path:
    """Where the real data lies: `MVTN_TEST_DATA`, else `shared/data` beside the checkout."""
    return Path(os.environ.get("MVTN_TEST_DATA") or REPOSITORY.parent / "shared" / "data")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real data; tests that need it skip, with this reason, where it is missing."""
    folder = data_folder()
    if not folder.is_dir():
        pytest.skip(f"real data not found: {folder}")
    return folder


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give each test an artifact directory of its own, so that none sees the user's."""
    cache = tmp_path / "cache"
    monkeypatch.setenv("MVTN_CACHE", str(cache))
    return cache
