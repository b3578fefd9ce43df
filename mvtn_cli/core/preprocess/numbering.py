"""ModelNet numbers each class's shapes through train first, then test: so a name tells its official split."""

from __future__ import annotations

import re

from mvtn_cli.core.datasets import Dataset, Item
from mvtn_cli.core.datasets.official import Official


def misplaced(dataset: Dataset, official: Official) -> list[str]:
    """Return the names of the shapes that are officially in another split; names of other forms are passed over."""
    return [item.name for item in dataset.items if _split(item, dataset, official) not in (None, item.split)]


def unseen(dataset: Dataset, official: Official) -> list[str]:
    """Return the names that should be there and are not, class by class."""
    there = {item.name.rpartition("/")[2] for item in dataset.items}
    listed = (
        f"{name}_{number:04d}"
        for name, counts in official.classes.items()
        for number in range(1, sum(counts.values()) + 1)
    )
    return [name for name in listed if name not in there]


def _split(item: Item, dataset: Dataset, official: Official) -> str | None:
    match = re.search(r"([^/]+)_(\d{4})$", item.name)
    if match is None or not 0 <= item.label < len(dataset.classes) or match[1] != dataset.classes[item.label]:
        return None
    number, counts = int(match[2]), official.classes.get(match[1], {})
    for split, count in counts.items():
        if number <= count:
            return split
        number -= count
    return None
