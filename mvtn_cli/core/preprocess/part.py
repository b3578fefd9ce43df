"""Some shapes of a data set, as another process is sent them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from mvtn_cli.core.preprocess.prepared import Prepared, Record, ShapeMemory
from mvtn_cli.core.store import Store, StoredShape
from mvtn_cli.errors import DataError

IN_MEMORY = 64 << 20  # bytes of shapes kept: those of a batch are asked for twice


@dataclass(frozen=True)
class Part:
    """Records and where their shapes are stored: what a Prepared has, without its sources.

    Attributes:
        spec: The word that opens the data set again.
        records: Of the shapes.
        store: Where they lie.
    """

    spec: str
    records: tuple[Record, ...] = field(repr=False)
    store: Store
    memory: ShapeMemory = field(default_factory=lambda: ShapeMemory(IN_MEMORY), repr=False, compare=False)

    @classmethod
    def of(cls, prepared: Prepared, indices: Sequence[int]) -> Part:
        """Take some records of a data set, in this order."""
        return cls(prepared.spec, tuple(prepared.records[index] for index in indices), prepared.store)

    def load(self, index: int) -> StoredShape:
        """Return shape number `index` of the part.

        Raises:
            DataError: It is missing or damaged.
        """
        record = self.records[index]
        shape = self.memory.shapes.get(record.address) or self.store.read(record.address)
        if shape is None:
            raise DataError(
                f"the stored shape of {record.name} is missing or damaged in {self.store.root}",
                hint=f"mvtn preprocess {self.spec} makes it again",
                code="store.missing",
            )
        self.memory.keep(record.address, shape)
        return shape
