"""The rules of SHREC'17 track 3 (large-scale retrieval from ShapeNet Core55): how lists are scored, written and read.

Each shape of a split queries its split, itself included, and answers with a ranked list of at most 1000 shapes.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.evaluation.files import write_csv
from mvtn_cli.core.reporting.file_names import write_picture
from mvtn_cli.core.retrieval.curves import curves_of, interpolated
from mvtn_cli.core.retrieval.metrics import f1
from mvtn_cli.core.retrieval.ranks import LEVELS
from mvtn_cli.errors import DataError

MEASURES = ("P@N", "R@N", "F1@N", "mAP", "NDCG")
LONGEST = 1000  # results of a query that are read
DIGITS = 6
Labels = NDArray[Any]
List = Sequence[tuple[str, float]]  # (id, distance), the nearest first


@dataclass(frozen=True)
class Truth:
    """What the shapes of one split are.

    Attributes:
        ids: N identifiers of six digits.
        synsets: N classes.
        subsynsets: N finer classes; a shape that is only known by its class has that one's name.
    """

    ids: tuple[str, ...]
    synsets: tuple[str, ...]
    subsynsets: tuple[str, ...]


def gains(synsets: Labels, subsynsets: Labels, query: int) -> NDArray[np.int64]:
    """What each shape is worth to a query, (N,).

    3: the same sub-synset. 2: the same synset, and the found shape is only known by the synset that the query's
    is. 1: another sub-synset of the same synset. 0: another synset.
    """
    worth = np.where(subsynsets == synsets[query], 2, 1)
    worth[subsynsets == subsynsets[query]] = 3
    return np.where(synsets == synsets[query], worth, 0)


def score_lists(truth: Truth, lists: Mapping[str, List]) -> dict[str, Any]:
    """Score ranked lists by the rules; the distances in them are not looked at.

    Per query with a list of N: P = hits/N, R = hits/min(relevant, 1000), F1 of the two; AP is the mean precision at
    the hits over all relevant shapes of the split; DCG = g_1 + Σ g_i / log2(i) from i = 2, over that of the best list
    of 1000. Shapes of unknown identifier and second mentions are dropped; no list counts as 0.

    Args:
        truth: The split.
        lists: By the query's identifier.

    Returns:
        `micro` (mean of queries), `macro` (mean of the means of synsets), `mean` of the two, by which the challenge
        ranks, `per_class`, `queries` and `unanswered`, and `precision_recall` of all relevant shapes (`curves_of`).
    """
    number = {name: index for index, name in enumerate(truth.ids)}
    names, codes = np.unique([truth.synsets, truth.subsynsets], return_inverse=True)
    synsets, subsynsets = codes.reshape(2, -1)
    rows, curves, unanswered = np.zeros((len(truth.ids), len(MEASURES))), np.zeros((len(truth.ids), LEVELS)), 0
    for query, name in enumerate(truth.ids):
        found = _known(lists.get(name, ()), number)
        unanswered += not found
        if found:
            rows[query], curves[query] = _score_one(gains(synsets, subsynsets, query), found)
    by_class = {str(names[code]): rows[synsets == code] for code in np.unique(synsets)}
    micro = rows.mean(axis=0)
    macro = np.mean([mine.mean(axis=0) for mine in by_class.values()], axis=0)
    return {
        "queries": len(truth.ids),
        "unanswered": unanswered,
        "micro": _named(micro),
        "macro": _named(macro),
        "mean": _named((micro + macro) / 2),
        "per_class": [
            {"name": name, "queries": len(own), **_named(own.mean(axis=0))} for name, own in by_class.items()
        ],
        "precision_recall": curves_of(curves, names[synsets]),
    }


def _known(entries: List, number: Mapping[str, int]) -> list[int]:
    """Rows of the listed shapes: the first 1000 entries, without strangers and repetitions."""
    names = (name.zfill(DIGITS) for name, _ in entries[:LONGEST])
    return list(dict.fromkeys(number[name] for name in names if name in number))


def _score_one(worth: NDArray[np.int64], found: Sequence[int]) -> tuple[tuple[float, ...], NDArray[np.float64]]:
    gained = worth[list(found)]
    hit, relevant = gained > 0, int((worth > 0).sum())
    precision = np.array(hit.sum() / len(found))
    recall = np.array(hit.sum() / min(relevant, LONGEST))
    at_hits = (np.cumsum(hit) / np.arange(1, len(found) + 1))[hit]
    ideal = np.sort(worth)[::-1][:LONGEST]
    measures = (
        float(precision),
        float(recall),
        float(f1(precision, recall)),
        float(at_hits.sum() / relevant),
        _dcg(gained) / _dcg(ideal),
    )
    return measures, interpolated(at_hits, relevant)


def _dcg(gained: NDArray[np.int64]) -> float:
    discount = np.maximum(np.log2(np.arange(1, len(gained) + 1)), 1.0)  # none at the first two positions
    return float((gained / discount).sum())


def _named(values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip(MEASURES, values.tolist(), strict=True))


# Files


def write_lists(folder: Path, lists: Mapping[str, List]) -> None:
    """Write one file a query, named by its identifier: a line `id distance` a result."""
    for query, entries in lists.items():
        lines = "".join(f"{name} {distance:.9g}\n" for name, distance in entries)
        write_picture(folder / query, lines.encode())


def read_lists(folder: Path) -> dict[str, list[tuple[str, float]]]:
    """Read what `write_lists` or any other participant wrote.

    Raises:
        DataError: A line is not `id distance`.
    """
    lists = {}
    for path in sorted(path for path in folder.iterdir() if path.name.isdecimal()):
        lists[path.name.zfill(DIGITS)] = [
            _entry(line, path, number)
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
            if line.strip()
        ]
    return lists


def _entry(line: str, path: Path, number: int) -> tuple[str, float]:
    try:
        name, distance = line.split()
        return name, float(distance)
    except ValueError:
        raise DataError(
            f"{path}, line {number}: expected an identifier and a distance, got '{line.strip()[:40]}'",
            hint="one result a line, as: 000123 0.4567",
            code="retrieval.list",
        ) from None


def write_truth(path: Path, truth: Truth, models: Sequence[str], split: str) -> None:
    """Write the list of a split as the challenge's `all.csv`: id, synsetId, subSynsetId, modelId, split."""
    rows = zip(truth.ids, truth.synsets, truth.subsynsets, models, strict=True)
    write_csv(path, ("id", "synsetId", "subSynsetId", "modelId", "split"), [(*row, split) for row in rows])


def read_truth(path: Path, split: str) -> Truth:
    """Read the shapes of one split from an `all.csv`."""
    with io.StringIO(path.read_text(encoding="utf-8")) as stream:
        rows = [row for row in csv.DictReader(stream) if row["split"] == split]
    columns = ("id", "synsetId", "subSynsetId")
    ids, synsets, subsynsets = (tuple(row[column] for row in rows) for column in columns)
    return Truth(ids, synsets, subsynsets)


def write_summary(path: Path, result: Mapping[str, Any], dataset: str, method: str) -> None:
    """Write scores as the official evaluator does: each class, then microALL and macroALL.

    Args:
        path: `METHOD.summary.csv`.
        result: Of `score_lists`.
        dataset: As the folder of the lists, e.g. `test_normal`.
        method: The participant.
    """
    rows = [*result["per_class"], *({"name": f"{kind}ALL", **result[kind]} for kind in ("micro", "macro"))]
    lines = [(row["name"], *(row[name] for name in MEASURES), dataset, method) for row in rows]
    write_csv(path, ("class", *MEASURES, "dataset", "method"), lines)
