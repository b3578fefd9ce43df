"""What the last run over a data set found, so that the next one need not open its files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mvtn_cli.core.datasets import Dataset, Item
from mvtn_cli.core.preprocess.making import Outcome
from mvtn_cli.core.preprocess.settings import Settings
from mvtn_cli.core.store import Store, file_stamp

Stamp = tuple[int, int]


class Memory:
    """The index of one data set under one set of settings.

    An item is up to date if its file has the size and time that the index remembers (or, for an item
    without a file, its content has the address), and the stored shape has the size and time at which it
    verified. Everything else is looked at again, rejected items always: their trouble may have been a
    passing one.
    """

    def __init__(self, store: Store, dataset: Dataset, settings: Settings) -> None:
        self._store = store
        self._name = settings.index_name(dataset.spec)
        self._spec = dataset.spec
        self._settings = settings
        self._entries = _entries(store.read_index(self._name))
        self._stamps: dict[Path, Stamp | None] = {}
        self._changed = False

    def recall(self, item: Item) -> Outcome | None:
        """Return the outcome of `item` if nothing has changed since, else None."""
        entry = self._entries.get(item.name)
        if entry is None:
            return None
        try:
            return self._recall(item, entry)
        except (KeyError, TypeError, ValueError):  # an index of another make: as good as none
            return None

    def _recall(self, item: Item, entry: Mapping[str, Any]) -> Outcome | None:
        address, stamp = entry["address"], tuple(entry["stored"])
        if item.path is not None:
            stamp_now = self.stamp(item.path)
            same = stamp_now is not None and [str(item.path), *stamp_now] == entry["file"]
        else:
            same = self._settings.address(item.content()) == address
        if not same or self._store.stamp(address) != stamp:
            return None
        return Outcome(
            address, "reused", tuple(entry["findings"]), entry["simplification"], entry["azimuth_deg"], stamp
        )

    def stamp(self, path: Path) -> Stamp | None:
        """Return size and time of a source file as first seen: what changes later counts as changed."""
        if path not in self._stamps:
            self._stamps[path] = file_stamp(path)
        return self._stamps[path]

    def remember(self, item: Item, outcome: Outcome) -> None:
        """Take note of what became of `item`."""
        self._changed = True
        stamp = None if item.path is None else self.stamp(item.path)
        if outcome.stamp is None or (item.path is not None and stamp is None):
            self._entries.pop(item.name, None)
            return
        self._entries[item.name] = {
            "address": outcome.address,
            "file": stamp and [str(item.path), *stamp],
            "stored": outcome.stamp,
            "findings": outcome.findings,
            "simplification": outcome.simplification,
            "azimuth_deg": outcome.known_azimuth_deg,
        }

    def save(self) -> None:
        """Write the index, if anything is new in it."""
        if self._changed:
            document = {"spec": self._spec, "settings": self._settings.as_dict(), "entries": self._entries}
            self._store.write_index(self._name, document)


def _entries(document: Mapping[str, Any] | None) -> dict[str, Any]:
    entries = (document or {}).get("entries")
    return entries if isinstance(entries, dict) else {}
