"""One trained run for all tests that only look at one."""

from __future__ import annotations

from pathlib import Path

import pytest
from demonstration import Demo, new_folder, play_demo
from processes import Folder, once


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    """The demo; its folder is not to be changed."""
    return once(tmp_path_factory, "demo", play_demo)


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    """A folder of one's own, with the tiny settings."""
    return new_folder(tmp_path / "work")
