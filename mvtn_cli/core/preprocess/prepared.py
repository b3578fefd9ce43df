"""A data set whose shapes are all stored."""

from __future__ import annotations

from dataclasses import dataclass, field

from mvtn_cli.console import Console
from mvtn_cli.core.datasets import Item
from mvtn_cli.core.preprocess.making import make
from mvtn_cli.core.preprocess.settings import Settings
from mvtn_cli.core.store import Store, StoredShape
from mvtn_cli.errors import DataError

IN_MEMORY = 1 << 30  # bytes of shapes kept by one Prepared


@dataclass(frozen=True)
class Record:
    """One usable shape: what it is called, what it is, and where it is stored.

    Attributes:
        name: Unique in its data set.
        label: Index into the classes, -1 without labels.
        split: `train`, `val` or `test`.
        address: Content address of the stored shape.
        source: The file, for people.
        known_azimuth_deg: Azimuth of its best view, NaN if none is known.
    """

    name: str
    label: int
    split: str
    address: str
    source: str
    known_azimuth_deg: float


@dataclass
class ShapeMemory:
    """Keeps what was loaded until `budget` bytes are full, and then what it has.

    No eviction: an epoch asks for every shape once, so that anything evicted for a newcomer would be missed
    as soon.
    """

    budget: int = IN_MEMORY
    shapes: dict[str, StoredShape] = field(default_factory=dict)
    used: int = 0

    def keep(self, address: str, shape: StoredShape) -> None:
        """Keep `shape` if there is room."""
        if address not in self.shapes and self.used + shape.nbytes <= self.budget:
            self.shapes[address] = shape
            self.used += shape.nbytes


@dataclass(frozen=True)
class Prepared:
    """Stored shapes in the order of their data set; rejected ones are not among them.

    Attributes:
        spec: The word that opens the data set again.
        title: One sentence about it.
        classes: Class names in the order of the labels; empty without labels.
        records: One for each usable shape.
        known_view: Whether the records know their best azimuth.
        address: Content address of the whole: classes, names, labels, splits and shapes.
        store: Where the shapes lie.
        settings: How they were made.
        items: Where they came from, one for each record.
    """

    spec: str
    title: str
    classes: tuple[str, ...]
    records: tuple[Record, ...] = field(repr=False)
    known_view: bool
    address: str
    store: Store
    settings: Settings
    items: tuple[Item, ...] = field(repr=False)
    console: Console = field(repr=False, compare=False)
    memory: ShapeMemory = field(default_factory=ShapeMemory, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.records)

    def load(self, index: int) -> StoredShape:
        """Return shape number `index`; the second time from memory.

        A stored file that is gone or does not verify is made again from its source, and that is said.

        Raises:
            DataError: The source is gone, bad, or no longer what was preprocessed.
        """
        address = self.records[index].address
        shape = self.memory.shapes.get(address)
        if shape is None:
            shape = self.store.read(address)
            if shape is None:
                shape = self._make_again(index)
            self.memory.keep(address, shape)
        return shape

    def split(self, name: str) -> list[int]:
        """Return the indices of a split's records."""
        return [index for index, record in enumerate(self.records) if record.split == name]

    def _make_again(self, index: int) -> StoredShape:
        record = self.records[index]
        self.console.warn(f"the stored shape of {record.name} is missing or damaged; it is made again")
        outcome = make(self.store, self.items[index], self.settings)
        shape = self.store.read(record.address) if outcome.address == record.address else None
        if shape is None:
            raise DataError(
                f"{record.source} is no longer what was preprocessed",
                hint=f"mvtn preprocess {self.spec}",
                code="dataset.changed",
            )
        return shape
