"""What of a long benchmark is finished: one line of JSON a stage, so that an interruption costs one stage."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from mvtn_cli import __version__
from mvtn_cli.console import dumps
from mvtn_cli.core.bench.document import cpu_name
from mvtn_cli.core.bench.growth_stages import Spent
from mvtn_cli.errors import MvtnError

FILE = "stages.jsonl"


class Remembered:
    """Finished stages of one machine, version and settings.

    Args:
        folder: Where the file is; lines of other settings in it are left alone.
        settings: What has a say in a time.
    """

    def __init__(self, folder: Path, settings: Mapping[str, int]) -> None:
        self.folder = folder
        self._about = {"version": __version__, "cpu": cpu_name(), **settings}
        self._found: dict[int, dict[str, Spent]] = {}
        for line in self._lines():
            self._take(line)

    def of(self, size: int) -> dict[str, Spent]:
        """What is known of a size, by stage."""
        return dict(self._found.get(size, {}))

    def add(self, size: int, stage: str, spent: Spent) -> None:
        """Keep one more.

        Raises:
            MvtnError: The file can't be written.
        """
        self._found.setdefault(size, {})[stage] = spent
        line = dumps({"about": self._about, "size": size, "stage": stage, "spent": asdict(spent)})
        try:
            with (self.folder / FILE).open("a", encoding="utf-8") as file:
                file.write(f"{line}\n")
        except OSError as error:
            raise MvtnError(
                f"can't write {self.folder / FILE}: {error.strerror or error}",
                hint="give another folder with --work",
                code="bench.growth",
            ) from error

    def _lines(self) -> list[str]:
        try:
            return (self.folder / FILE).read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError):
            return []

    def _take(self, line: str) -> None:
        try:
            entry = json.loads(line)
            if entry["about"] == self._about:
                self._found.setdefault(int(entry["size"]), {})[str(entry["stage"])] = Spent(**entry["spent"])
        except (ValueError, KeyError, TypeError):
            return  # a line that was cut off
