"""What is wrong with a data set: its counts beside the official ones, and one check for each known way to fail."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from mvtn_cli.core.datasets import SPLITS, Dataset, Item
from mvtn_cli.core.datasets.official import OFFICIAL, Official
from mvtn_cli.core.preprocess.clues import up_axis
from mvtn_cli.core.preprocess.examination import Examined
from mvtn_cli.core.preprocess.numbering import misplaced, unseen

State: TypeAlias = Literal["ok", "warn", "bad"]

NAMED = 3  # examples in a line for people; the document has all


@dataclass(frozen=True)
class Check:
    """One line of the report.

    Attributes:
        name: What was looked at.
        state: `bad` would spoil a benchmark, `warn` is worth knowing.
        count: How many shapes it is about.
        detail: One line for people.
    """

    name: str
    state: State
    count: int
    detail: str


@dataclass(frozen=True)
class Duplicates:
    """Shapes that are the same to a network, two or more."""

    items: tuple[Item, ...]

    @property
    def across(self) -> bool:
        """Whether they belong to different splits."""
        return len({item.split for item in self.items}) > 1

    @property
    def disagree(self) -> bool:
        """Whether they have different labels."""
        return len({item.label for item in self.items}) > 1


@dataclass(frozen=True)
class Diagnosis:
    """A data set, looked at from all sides.

    Attributes:
        dataset: As surveyed.
        examined: One for each of its items.
        official: What its distribution should hold; None for anybody's own shapes.
        duplicates: Groups of equal shapes.
        checks: The report.
    """

    dataset: Dataset
    examined: tuple[Examined, ...]
    official: Official | None
    duplicates: tuple[Duplicates, ...]
    checks: tuple[Check, ...]

    @property
    def bad(self) -> list[str]:
        """Names of the checks that would spoil a benchmark."""
        return [check.name for check in self.checks if check.state == "bad"]

    @property
    def mended(self) -> Counter[str]:
        """How many usable shapes have each finding that preprocessing mends."""
        return Counter(name for _, seen in self.items("ok") for name in seen.findings)

    @property
    def inside_out(self) -> list[str]:
        """Names of the usable meshes whose faces look inward."""
        return [item.name for item, seen in self.items("ok") if seen.winding == "in"]

    def items(self, state: str) -> list[tuple[Item, Examined]]:
        """Return the items in a state, with what was found."""
        return [pair for pair in zip(self.dataset.items, self.examined, strict=True) if pair[1].state == state]


def diagnose(dataset: Dataset, examined: Sequence[Examined]) -> Diagnosis:
    """Judge a data set by its items and what was found in each of them."""
    official = OFFICIAL.get(dataset.release)
    duplicates = find_duplicates(dataset.items, examined)
    diagnosis = Diagnosis(dataset, tuple(examined), official, duplicates, ())
    checks = (*_counts(diagnosis), *_shapes(diagnosis), *_duplicates(diagnosis), *_geometry(diagnosis))
    return Diagnosis(dataset, tuple(examined), official, duplicates, checks)


def find_duplicates(items: Sequence[Item], examined: Sequence[Examined]) -> tuple[Duplicates, ...]:
    """Group the items that have the same fingerprint, in the order of their first ones."""
    groups: dict[str, list[Item]] = {}
    for item, found in zip(items, examined, strict=True):
        if found.fingerprint:
            groups.setdefault(found.fingerprint, []).append(item)
    return tuple(Duplicates(tuple(group)) for group in groups.values() if len(group) > 1)


def count_table(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return a row for each class, and the last for all: `class`, `counts` by split, `official` by split or None.

    Classes that should be there and are not have a row of zeros.
    """
    dataset, official = diagnosis.dataset, diagnosis.official
    counts = Counter((item.label, item.split) for item in dataset.items)
    names = list(dataset.classes)
    rows = [_row(name, [counts[label, split] for split in SPLITS], official) for label, name in enumerate(names)]
    if official is not None:
        rows += [_row(name, [0] * len(SPLITS), official) for name in official.classes if name not in names]
    total = dict(zip(SPLITS, (dataset.count(split) for split in SPLITS), strict=True))
    return [*rows, {"class": "all", "counts": total, "official": official and dict(official.totals)}]


def _row(name: str, counts: Sequence[int], official: Official | None) -> dict[str, Any]:
    expected = official.classes.get(name) if official is not None else None
    return {"class": name, "counts": dict(zip(SPLITS, counts, strict=True)), "official": expected and dict(expected)}


def _counts(diagnosis: Diagnosis) -> Iterator[Check]:
    dataset, official = diagnosis.dataset, diagnosis.official
    if official is None:
        yield Check("official counts", "ok", 0, "none are known for this data set")
    else:
        yield _against(official, count_table(diagnosis), dataset)
    names = [name for part in dataset.missing for name in part.names]
    known = official.short if official is not None else 0
    state: State = "bad" if len(names) > known else "warn" if names else "ok"
    yield Check("listed shapes", state, len(names), f"not there: {_some(names)}" if names else "all are there")
    if official is not None and official.numbered:
        moved = misplaced(dataset, official)
        detail = f"officially in the other split: {_some(moved)}" if moved else "as the numbers of the shapes say"
        yield Check("official split", "bad" if moved else "ok", len(moved), detail)
    bare = [
        f"{row['class']} has no {split}"
        for row in count_table(diagnosis)[:-1]
        for split in ("train", "test")
        if not row["counts"][split]
    ]
    yield Check(
        "classes in splits", "warn" if bare else "ok", len(bare), _some(bare) if bare else "each is in train and test"
    )


def _against(official: Official, rows: list[dict[str, Any]], dataset: Dataset) -> Check:
    """Compare class by class where the official counts are known so, else the totals."""
    compared = rows[:-1] if official.classes else rows[-1:]
    fewer: list[tuple[int, str]] = []
    more: list[tuple[int, str]] = []
    for row in compared:
        for split, expected in (row["official"] or {}).items():
            count = row["counts"][split]
            if count != expected:
                words = f"{row['class']} {split} {count:,} of {expected:,}"
                (fewer if count < expected else more).append((abs(count - expected), words))
    lost, extra = (sum(count for count, _ in part) for part in (fewer, more))
    if lost > official.short:
        gone = unseen(dataset, official) if official.numbered else []
        example = f", as {_some(gone)}" if gone else ""
        return Check("official counts", "bad", lost, f"too few: {_some([words for _, words in fewer])}{example}")
    if lost or extra:
        words = _some([words for _, words in (*fewer, *more)])
        return Check("official counts", "warn", lost + extra, f"{words}{official.why and f'; {official.why}'}")
    return Check("official counts", "ok", 0, "as they should be")


def _shapes(diagnosis: Diagnosis) -> Iterator[Check]:
    for state, fine in (("unreadable", "each can be read"), ("empty", "each has something to draw")):
        found = diagnosis.items(state)
        words = [f"{item.name} ({seen.reason[:100]})" for item, seen in found]
        yield Check(state, "bad" if found else "ok", len(found), _some(words) if found else fine)
    yield _labels(diagnosis.dataset)
    census = ", ".join(f"{count:,} {name}" for name, count in diagnosis.mended.most_common())
    count = sum(bool(seen.findings) for _, seen in diagnosis.items("ok"))
    yield Check("mended", "ok", count, f"shapes by what preprocess mends: {census}" if census else "nothing to mend")


def _labels(dataset: Dataset) -> Check:
    labels = [item.label for item in dataset.items]
    if not dataset.classes:
        return Check("labels", "ok", 0, "this data set has none")
    wrong = sum(not 0 <= label < len(dataset.classes) for label in labels)
    span = f"{min(labels)} to {max(labels)}, {len(dataset.classes)} classes" if labels else "no shapes"
    return Check("labels", "bad" if wrong else "ok", wrong, f"out of range: {span}" if wrong else span)


def _duplicates(diagnosis: Diagnosis) -> Iterator[Check]:
    across = [group for group in diagnosis.duplicates if group.across]
    within = [group for group in diagnosis.duplicates if not group.across]
    yield _grouped("duplicates across splits", across, "bad")
    yield _grouped("duplicates within a split", within, "warn")
    if disagree := [group for group in diagnosis.duplicates if group.disagree]:
        yield _grouped("duplicates of two classes", disagree, "warn")


def _grouped(name: str, groups: Sequence[Duplicates], state: State) -> Check:
    words = [" = ".join(f"{item.split} {item.name}" for item in group.items[:2]) for group in groups]
    shapes = sum(len(group.items) for group in groups)
    return Check(name, state if groups else "ok", shapes, _some(words) if groups else "none")


def _geometry(diagnosis: Diagnosis) -> Iterator[Check]:
    usable = diagnosis.items("ok")
    meshes = [(item, seen) for item, seen in usable if seen.winding is not None]
    if meshes:
        inside = diagnosis.inside_out
        words = f"inside out: {_some(inside)}; pictures show both sides, so it does no harm here"
        fine = f"no mesh of {len(meshes):,} is inside out"
        yield Check("winding", "warn" if inside else "ok", len(inside), words if inside else fine)
    hint = up_axis(_asymmetries(usable))
    if not hint:
        yield Check("up axis", "ok", 0, "not told by the shapes: they differ too little, or are not aligned")
    elif hint == "y":
        yield Check("up axis", "ok", 0, "y, as the shapes look")
    else:
        words = f"the shapes look {hint} up, as they were read; for folders, ?up=z turns them"
        yield Check("up axis", "warn", len(usable), words)


def _asymmetries(pairs: Sequence[tuple[Item, Examined]]) -> np.ndarray:
    return np.array([seen.asymmetry for _, seen in pairs if seen.asymmetry is not None]).reshape(-1, 3)


def axis_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the up axis that the shapes hint at (empty if they don't), and the mean asymmetry along each axis."""
    values = _asymmetries(diagnosis.items("ok"))
    mean = values.mean(axis=0).round(4).tolist() if len(values) else [None] * 3
    return {"hint": up_axis(values), "asymmetry": dict(zip("xyz", mean, strict=True))}


def _some(words: Sequence[str]) -> str:
    return ", ".join(words[:NAMED]) + (f" and {len(words) - NAMED:,} more" if len(words) > NAMED else "")
