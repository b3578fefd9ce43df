"""SHREC'17's list of ShapeNet Core55: id,synsetId,subSynsetId,modelId,split."""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mvtn_cli.core.datasets.dataset import SPLITS
from mvtn_cli.core.datasets.layouts import where
from mvtn_cli.errors import DataError

WHOLE = ("all.csv", "all.csv.gz", "shapenet_split.csv", "shapenet_split.csv.gz")
PARTS = tuple(f"{split}.csv" for split in SPLITS)  # before the labels of the test set were published
COLUMNS = ("id", "synsetId", "subSynsetId", "modelId", "split")


class Row(NamedTuple):
    """One model: its six digits, its synset and sub-synset of eight, its folder in ShapeNetCore, its split."""

    id: str
    synset: str
    subsynset: str
    model: str
    split: str


def find_lists(root: Path) -> list[Path]:
    """Return the list below `root` or beside it, as one file or one for each split; empty if there is none."""
    for folder in (root, root.absolute().parent):
        for name in WHOLE:
            if (folder / name).is_file():
                return [folder / name]
        if parts := [folder / name for name in PARTS if (folder / name).is_file()]:
            return parts
    return []


def is_shapenet_list(path: Path) -> bool:
    """Tell whether the file has the columns of the list."""
    try:
        return next(_lines(path), None) is not None
    except (DataError, OSError, EOFError, UnicodeDecodeError, zlib.error, csv.Error):
        return False


def read_lists(paths: Sequence[Path], synsets: Collection[str]) -> list[Row]:
    """Read the list.

    Args:
        paths: As `find_lists` found them.
        synsets: The known ones.

    Returns:
        Rows in the order of the files; ids and synsets with the zeros that spreadsheets take away.

    Raises:
        DataError: Not such a list, an unknown synset or split, or an id that comes twice.
    """
    known, seen = frozenset(synsets), set[str]()
    rows: list[Row] = []
    for path in paths:
        try:
            for number, row in _lines(path):
                _check(path, number, row, known, seen)
                rows.append(row)
        except (OSError, EOFError, UnicodeDecodeError, zlib.error, csv.Error) as error:
            raise _bad(path, str(error).splitlines()[0]) from error
    return rows


def _lines(path: Path) -> Iterator[tuple[int, Row]]:
    """Yield the rows with their line numbers; the columns may stand in any order."""
    opener: Any = gzip.open if path.suffix == ".gz" else open
    with opener(path, "rt", encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file)
        header = [name.strip() for name in next(reader, [])]
        if not set(COLUMNS) <= set(header):
            raise _bad(path, f"its first line is '{','.join(header)[:80]}'")
        places = [header.index(name) for name in COLUMNS]
        for cells in reader:
            if not cells:
                continue
            if len(cells) <= max(places):
                raise _bad(path, f"line {reader.line_num} has {len(cells)} cells")
            number, synset, subsynset, model, split = (cells[place].strip() for place in places)
            finer = subsynset and subsynset.zfill(8)
            yield reader.line_num, Row(number.zfill(6), synset.zfill(8), finer, model, split.lower())


def _check(path: Path, number: int, row: Row, synsets: frozenset[str], seen: set[str]) -> None:
    if row.synset not in synsets:
        raise _bad(path, f"line {number}: synset '{row.synset[:20]}' is none of the {len(synsets)} of Core55")
    if row.split not in SPLITS:
        raise _bad(path, f"line {number}: split '{row.split[:20]}' is none of train, val, test")
    if row.id in seen:
        raise _bad(path, f"line {number}: id {row.id[:20]} is there twice")
    seen.add(row.id)


def _bad(path: Path, reason: str) -> DataError:
    return DataError(
        f"{path} is not SHREC'17's list: {reason}",
        hint=f"expected the columns {','.join(COLUMNS)}; {where('shapenet55')}",
        code="dataset.bad-list",
    )
