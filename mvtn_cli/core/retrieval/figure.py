"""The paper's figure: a few queries and their nearest training shapes, the wrong ones framed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mvtn_cli.core.retrieval.distances import Gallery
from mvtn_cli.core.retrieval.pictures import Found, found_sheet, tiles
from mvtn_cli.core.retrieval.searchable import Rows, Searchable, labels_of
from mvtn_cli.core.training.checkpoint import write_run_file
from mvtn_cli.core.training.split import stratified_subset

if TYPE_CHECKING:
    from mvtn_cli.retrieve_config import RetrieveConfig

FIGURE_HITS = 10


def write_figure(
    folder: Path, searchable: Searchable, indices: Sequence[int], rows: Rows, config: RetrieveConfig
) -> str | None:
    """Write `figure.png`: some queries, one of each class in turn, and their ten nearest training shapes.

    Args:
        folder: Where to.
        searchable: The training shapes.
        indices: Q queries.
        rows: (Q, d), what of them is compared.
        config: `figure` (how many), `metric` and `seed` hold.

    Returns:
        The path; None where none is wanted.
    """
    if not config.figure:
        (folder / "figure.png").unlink(missing_ok=True)
        return None
    prepared, labels = searchable.prepared, labels_of(searchable.prepared, indices)
    chosen = stratified_subset(range(len(indices)), labels.tolist(), config.figure, config.seed)
    near, _ = Gallery.of(searchable.rows, config.metric).nearest(rows[chosen], FIGURE_HITS)
    settings = searchable.describer.run.config
    found = []
    for row, hits in zip(chosen, near, strict=True):
        pictures = tiles(prepared, [indices[row], *(searchable.indices[k] for k in hits)], settings)
        theirs = searchable.labels[hits]
        title = prepared.classes[labels[row]]
        captions = [prepared.classes[label] for label in theirs]
        found.append(Found(pictures[0], title, pictures[1:], captions, (theirs != labels[row]).tolist()))
    write_run_file(folder / "figure.png", found_sheet(found))
    return str(folder / "figure.png")
