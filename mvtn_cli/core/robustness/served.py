"""A data set whose shapes are corrupted on their way out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from mvtn_cli.core.robustness.corruption import Corruption
from mvtn_cli.core.robustness.occlusion import Corrupted
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.training.shapes import Shapes


@dataclass(frozen=True)
class CorruptedShapes:
    """Serves corrupted shapes in place of a data set's own.

    It has no store: the views kept there under a shape's address (`core/training/fixed_views.py`) are those of the
    shape as it was, and must not be shown for what has become of it.

    Attributes:
        shapes: The data set.
        corruption: What is done to each of its shapes.
        capacity: How many corrupted shapes are kept: those of a batch are asked for twice.
        points_left, area_left: Shares of what is left of each shape that was asked for, by index.
    """

    shapes: Shapes
    corruption: Corruption
    capacity: int = 33
    points_left: dict[int, float] = field(default_factory=dict, repr=False)
    area_left: dict[int, float] = field(default_factory=dict, repr=False)
    _kept: dict[int, StoredShape] = field(default_factory=dict, repr=False)

    @property
    def records(self) -> Sequence[Any]:
        """As the data set's."""
        return self.shapes.records

    def load(self, index: int) -> StoredShape:
        """Read one shape and corrupt it: the same way each time, alone or in any company."""
        found = self._kept.get(index)
        if found is None:
            found = self._remember(index, self.corruption.apply(self.shapes.load(index), self.records[index].name))
        return found

    def _remember(self, index: int, made: Corrupted) -> StoredShape:
        self.points_left[index], self.area_left[index] = made.points_left, made.area_left
        while len(self._kept) >= self.capacity:
            del self._kept[next(iter(self._kept))]
        self._kept[index] = made.shape
        return made.shape
