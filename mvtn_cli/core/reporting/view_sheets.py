"""What cameras see of shapes: a sheet a shape, on request every view and output as a file, and all cameras."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.core.render.warming import compile_renderer
from mvtn_cli.core.reporting.file_names import safe_name, write_document
from mvtn_cli.core.reporting.shape_files import Subject, write_shape
from mvtn_cli.core.reporting.view_cameras import Placed, view_settings
from mvtn_cli.core.training.device import use_threads
from mvtn_cli.core.training.shapes import load_batch
from mvtn_cli.errors import DataError, MvtnError

if TYPE_CHECKING:
    from mvtn_cli.console import Console
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.render_views_config import RenderViewsConfig

AT_ONCE = 16  # shapes whose cameras are chosen together
CAMERAS_FILE = "cameras.json"


def render_views(
    parts: Iterable[Prepared], config: RenderViewsConfig, console: Console, *, total: int | None = None
) -> Iterator[dict[str, Any]]:
    """Draw shapes from fixed, given or learned cameras.

    Writes `OUT/NAME.png`, a sheet of the shape's views; into `OUT/NAME/` what else the configuration asks for
    (see `write_shape`); and at the end, also at an early one, `OUT/cameras.json`. With a run, its learned
    cameras are taken and its picture settings, as far as the configuration does not say otherwise.

    Args:
        parts: What to draw, one part after another; a data set is one part. Of files without labels all are
            drawn, of a data set `limit` shapes of `split`, each class in turn.
        config: What to draw, how, and where to.
        console: For progress.
        total: How many shapes there are; None counts them, for which `parts` must be a sequence.

    Yields:
        For each shape, once its files are written: `file`, `name`, `label`, `picture` (the sheet), `views`, each
        with `azimuth_deg`, `elevation_deg`, `distance` and the paths of its pictures, and the paths of all else.
        For a shape that can't be drawn as asked: `file`, `name`, `label` and `error`, which was said as a warning.

    Raises:
        DataError: There is no shape in the split.
        MvtnError: A file can't be written.
    """
    use_threads(config.threads)
    compile_renderer(console)
    place, settings = view_settings(config)
    if total is None:
        parts = list(parts)
        total = sum(len(chosen_shapes(part, config)) for part in parts)
    taken: set[str] = set()
    answers: list[dict[str, Any]] = []
    out = Path(config.out)
    try:
        with console.progress("drawing", total) as ticker:
            for prepared, index, placed in _one_by_one(parts, config, place):
                answer = _draw(prepared, index, placed, settings, config, taken)
                if "error" in answer:
                    console.warn(f"{answer['file']}: {answer['error']}")
                else:
                    answers.append(answer)
                yield answer
                ticker.advance()
    except BaseException:
        with suppress(MvtnError):  # what ended the work is the error, not that this can't be written either
            _write_cameras(out, answers, settings)
        raise
    _write_cameras(out, answers, settings)


def _one_by_one(
    parts: Iterable[Prepared], config: RenderViewsConfig, place: Any
) -> Iterator[tuple[Prepared, int, Placed]]:
    """Each shape to draw with its own cameras, (1, M)."""
    before = 0
    for prepared in parts:
        indices = chosen_shapes(prepared, config)
        for begin in range(0, len(indices), AT_ONCE):
            chunk = indices[begin : begin + AT_ONCE]
            cameras, light = place(prepared, chunk, before)
            before += len(chunk)
            for row, index in enumerate(chunk):
                own = None if light is None else light[row : row + 1]
                yield prepared, index, Placed(cameras.select(shapes=[row]), own)


def _draw(
    prepared: Prepared, index: int, placed: Placed, settings: Any, config: RenderViewsConfig, taken: set[str]
) -> dict[str, Any]:
    """Draw and write one shape; returns its answer."""
    record = prepared.records[index]
    label = prepared.classes[record.label] if 0 <= record.label < len(prepared.classes) else None
    answer = {"file": record.source, "name": record.name, "label": label}
    try:
        batch, kind = load_batch(prepared, [index], settings.render)
        if kind == "points" and "normals" in config.outputs:
            raise DataError("points have no normals; leave normals out of --outputs")
    except DataError as error:
        return {**answer, "error": error.message}
    stored = prepared.load(index)
    about = {**answer, "center": stored.center.tolist(), "radius": float(stored.radius)}
    subject = Subject(safe_name(record.name, taken), batch, kind, placed, about)
    return {**answer, **write_shape(Path(config.out), subject, settings, config)}


def _write_cameras(out: Path, answers: Sequence[dict[str, Any]], settings: Any) -> None:
    write_document(
        out / CAMERAS_FILE,
        {
            "schema": "mvtn.cameras/1",
            "fov_deg": settings.fov,
            "image_size": settings.image_size,
            "shapes": answers,
        },
    )


def chosen_shapes(prepared: Prepared, config: RenderViewsConfig) -> list[int]:
    """Find what is to be drawn: all of single files, some of a data set with every class in turn.

    Raises:
        DataError: The split is empty.
    """
    from mvtn_cli.core.training.split import stratified_subset

    labels = [record.label for record in prepared.records]
    if all(label < 0 for label in labels):
        return list(range(len(labels)))
    indices = prepared.split(config.split)
    if not indices:
        raise DataError(
            f"no shapes for split '{config.split}' in {prepared.spec}",
            hint="try another --split",
            code="dataset.empty-split",
        )
    return stratified_subset(indices, [labels[i] for i in indices], config.limit, config.seed)
