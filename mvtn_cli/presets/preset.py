"""What a preset is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Setting:
    """A value, and where it comes from.

    Attributes:
        value: As the option takes it.
        source: Who says so, and who says otherwise.
    """

    value: Any
    source: str


@dataclass(frozen=True)
class Figure:
    """A published number.

    Attributes:
        table: Where it stands.
        row: Its row there.
        percent: The number; None where the row's own number is not known here.
        measure: What it is, as "accuracy" or "mAP".
        source: How it is known.
    """

    table: str
    row: str
    percent: float | None = None
    measure: str = "accuracy"
    source: str = ""

    @property
    def words(self) -> str:
        """As people write it: `93.8 % accuracy`; empty without a number."""
        return "" if self.percent is None else f"{self.percent:.1f} % {self.measure}"


@dataclass(frozen=True)
class Preset:
    """One row.

    Attributes:
        name: As `--preset` takes it.
        data: The data set that the row is about, as `mvtn train` takes it.
        figures: The row's numbers; the first one names it.
        settings: What it sets, by field of `TrainConfig`.
        notes: In which other ways the paper, the released code and this program differ.
    """

    name: str
    data: str
    figures: tuple[Figure, ...]
    settings: Mapping[str, Setting]
    notes: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, Any]:
        """What it sets, without sources."""
        return {field: setting.value for field, setting in self.settings.items()}

    @property
    def table(self) -> str:
        """The table of its first figure."""
        return self.figures[0].table

    @property
    def row(self) -> str:
        """The row of its first figure."""
        return self.figures[0].row
