"""A run as a participant of SHREC'17: a split of its data set searches itself, and the lists are scored and written."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.datasets.shapenet import SYNSETS
from mvtn_cli.core.evaluation.files import write_csv
from mvtn_cli.core.retrieval.curves import draw_curves, write_curves
from mvtn_cli.core.retrieval.descriptors import labelled
from mvtn_cli.core.retrieval.figure import write_figure
from mvtn_cli.core.retrieval.index import search
from mvtn_cli.core.retrieval.shrec17 import (
    DIGITS,
    LONGEST,
    MEASURES,
    List,
    Truth,
    score_lists,
    write_lists,
    write_summary,
    write_truth,
)

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.retrieval.searchable import Searchable
    from mvtn_cli.retrieve_config import RetrieveConfig


def measure_shrec17(searchable: Searchable, config: RetrieveConfig, folder: Path) -> dict[str, Any]:
    """Let a split search itself and score the lists; see `retrieve_run`.

    With `config.out`, writes what a participant sends, `OUT/SPLIT_normal/000123` (or `_perturbed`), one file a query;
    the truth that they are scored by, `OUT/all.csv`; and the scores as the official evaluator writes them,
    `OUT/RUN.summary.csv` and `OUT/RUN.pr.csv`.
    """
    prepared = searchable.prepared
    indices = labelled(prepared, config.split)
    ids = identifiers(prepared, indices)
    order = np.argsort(ids)  # so that equally far shapes are listed by identifier, whatever the order of the files
    indices, ids = [indices[i] for i in order], [ids[i] for i in order]
    described = searchable.describer.describe(prepared, indices)
    rows = searchable.map(described)
    begun = time.monotonic()
    groups = described.predicted if config.lists == "same-class" else np.zeros(len(ids), np.int64)
    lists, about = ranked_lists(rows, ids, groups, config)
    truth = truth_of(prepared, indices, ids)
    found = score_lists(truth, lists)
    curves = found["precision_recall"]
    if config.out is not None:
        dataset, method = f"{config.split}_{variant(prepared)}", searchable.describer.run.name
        write_lists(folder / dataset, lists)
        write_summary(folder / f"{method}.summary.csv", found, dataset, method)
        write_curves(folder / f"{method}.pr.csv", curves)
        write_truth(folder / "all.csv", truth, [prepared.records[i].name for i in indices], config.split)
    columns = ("name", "queries", *MEASURES)
    write_csv(folder / "per_class.csv", columns, [[row[key] for key in columns] for row in found["per_class"]])
    write_curves(folder / "precision_recall.csv", curves)
    draw_curves(folder, curves, f"{searchable.describer.run.name}: {config.split} shapes search each other, SHREC'17")
    return {
        "gallery": {"split": config.split, "count": len(ids)},
        "split": config.split,
        "lists": config.lists,
        **found,
        "index": about,
        "seconds_scoring": time.monotonic() - begun,
        "figure": write_figure(folder, searchable, indices, rows, config),
    }


class RankedLists(Mapping[str, List]):
    """The list of each query, made when it is asked for: ten million pairs of a name and a number take a gigabyte."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[list[str], NDArray[np.int64], NDArray[np.float64]]] = {}

    def add(self, query: str, names: list[str], near: NDArray[np.int64], far: NDArray[np.float64]) -> None:
        """Keep an answer: places in `names`, -1 where nothing was found, and their distances."""
        self._found[query] = names, near[near >= 0], far[near >= 0]

    def __getitem__(self, query: str) -> List:
        names, near, far = self._found[query]
        return [(names[k], distance) for k, distance in zip(near.tolist(), far.tolist(), strict=True)]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)


def ranked_lists(
    rows: NDArray[np.float64], ids: list[str], groups: NDArray[np.int64], config: RetrieveConfig
) -> tuple[RankedLists, dict[str, Any]]:
    """Rank for each shape the at most 1000 nearest of its group, itself included; also what is known of the search."""
    lists = RankedLists()
    about: list[dict[str, Any]] = []
    for group in np.unique(groups):
        members = np.flatnonzero(groups == group)
        names = [ids[row] for row in members]
        found = search(rows[members], rows[members], LONGEST, config.metric, config.index)
        about.append(found.about)
        for query, near, far in zip(names, found.indices, found.distances, strict=True):
            lists.add(query, names, near, far)
    whole = {"name": config.index, "seconds": sum(part["seconds"] for part in about)}
    if "recall" in about[0]:
        whole["recall"] = float(np.average([p["recall"] for p in about], weights=[p["judged"] for p in about]))
    return lists, whole


def identifiers(prepared: Prepared, indices: list[int]) -> list[str]:
    """Give each shape six digits: ShapeNet's own, elsewhere its place among the names."""
    names = [prepared.records[i].name for i in indices]
    last = [name.rpartition("/")[2] for name in names]
    if len(set(last)) == len(last) and all(len(name) == DIGITS and name.isdecimal() for name in last):
        return last
    place = {name: number for number, name in enumerate(sorted(names))}
    return [f"{place[name]:0{DIGITS}d}" for name in names]


def truth_of(prepared: Prepared, indices: list[int], ids: list[str]) -> Truth:
    """Classes and finer classes of some shapes; without finer ones each class is its own."""
    words = SYNSETS if _is_shapenet(prepared) else prepared.classes
    synsets = [words[prepared.records[i].label] for i in indices]
    finer = [prepared.items[i].subclass for i in indices]
    subsynsets = [own or synset for own, synset in zip(finer, synsets, strict=True)]
    return Truth(tuple(ids), tuple(synsets), tuple(subsynsets))


def variant(prepared: Prepared) -> str:
    """Whether the shapes are as modelled (`normal`) or turned at random (`perturbed`)."""
    return "perturbed" if prepared.spec.endswith("@perturbed") else "normal"


def _is_shapenet(prepared: Prepared) -> bool:
    return prepared.spec.startswith("shapenet55") and len(prepared.classes) == len(SYNSETS)
