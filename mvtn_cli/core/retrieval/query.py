"""Find the training shapes of a run that are most like a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.core.reporting.file_names import safe_name, write_picture
from mvtn_cli.core.retrieval.index import search
from mvtn_cli.core.retrieval.pictures import MOST, Found, found_sheet, tiles

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.retrieval.searchable import Searchable
    from mvtn_cli.retrieve_config import RetrieveConfig


@dataclass
class Finder:
    """Answers queries.

    Attributes:
        searchable: What is searched.
        config: `top`, `metric` and `index` hold.
        out: Folder of the pictures.
        taken: Names of pictures so far.
    """

    searchable: Searchable
    config: RetrieveConfig
    out: Path
    taken: set[str] = field(default_factory=set)

    def find(self, prepared: Prepared, files: Sequence[str]) -> Iterator[dict[str, Any]]:
        """Answer for each file, and write its picture `OUT/NAME.png`: the file and at most 50 hits.

        Args:
            prepared: The files, prepared like the shapes of the run.
            files: How each was called, in the order of the records.

        Yields:
            `query`, `class` (None where it is not known), `hits`, each with `rank`, `name`, `class`, `distance`,
            `file`, and `picture`.
        """
        here = self.searchable
        rows = here.map(here.describer.describe(prepared, range(len(prepared))))
        found = search(here.rows, rows, self.config.top, self.config.metric, self.config.index)
        for row, file in enumerate(files):
            near = [k for k in found.indices[row].tolist() if k >= 0]
            label = self.known_class(prepared.records[row].source)
            hits = [self._hit(k, place, float(found.distances[row, place])) for place, k in enumerate(near)]
            picture = self._picture(prepared, row, label, hits, near)
            answer = {"query": file, "class": label, "hits": hits, "picture": str(picture)}
            yield answer | ({"recall": found.about["recall"]} if "recall" in found.about else {})

    def known_class(self, source: str) -> str | None:
        """The class of a file: the data set's, if it is one of its shapes, else that of a folder it lies in."""
        there = self.searchable.prepared
        for record in there.records:
            if record.source == source and record.label >= 0:
                return there.classes[record.label]
        folders = [parent.name for parent in Path(source).parents]
        return next((name for name in folders if name in there.classes), None)

    def _hit(self, number: int, place: int, distance: float) -> dict[str, Any]:
        here = self.searchable
        record = here.prepared.records[here.indices[number]]
        known = here.prepared.classes[record.label]
        return {"rank": place + 1, "name": record.name, "class": known, "distance": distance, "file": record.source}

    def _picture(
        self, prepared: Prepared, row: int, label: str | None, hits: Sequence[dict[str, Any]], near: Sequence[int]
    ) -> Path:
        here, settings = self.searchable, self.searchable.describer.run.config
        record, shown = prepared.records[row], hits[:MOST]
        own = tiles(prepared, [row], settings)[0]
        theirs = tiles(here.prepared, [here.indices[k] for k in near[:MOST]], settings)
        captions = [f"{hit['class']} {hit['distance']:.3g}" for hit in shown]
        wrong = [label is not None and hit["class"] != label for hit in shown]
        title = label or ""
        path = self.out / f"{safe_name(record.name, self.taken)}.png"
        write_picture(path, found_sheet([Found(own, title, theirs, captions, wrong)], record.name))
        return path
