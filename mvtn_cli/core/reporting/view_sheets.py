"""What cameras see of shapes: a sheet a shape, single pictures, and a file of all cameras."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mvtn_cli.core.evaluation.files import write_json
from mvtn_cli.core.evaluation.pictures import draw_shapes
from mvtn_cli.core.evaluation.views import standard_angles
from mvtn_cli.core.render.compiled import announce_compilation
from mvtn_cli.core.reporting import words
from mvtn_cli.core.reporting.images import contact_sheet, png
from mvtn_cli.core.training.checkpoint import write_run_file
from mvtn_cli.core.views import layouts
from mvtn_cli.errors import DataError

if TYPE_CHECKING:
    from mvtn_cli.config import RenderViewsConfig
    from mvtn_cli.console import Console
    from mvtn_cli.core.preprocess import Prepared

SHEET_COLUMNS = 6
AT_ONCE = 16  # shapes; what a look at the first results waits for
CAMERAS_FILE = "cameras.json"

Array = NDArray[np.float64]


def render_views(prepared: Prepared, config: RenderViewsConfig, console: Console) -> Iterator[dict[str, Any]]:
    """Draw shapes from fixed, given or learned cameras.

    Writes `OUT/NAME.png`, a sheet of the shape's views; with `per_view` also `OUT/NAME/view_01.png` and so
    on; and at the end `OUT/cameras.json`. With a run, its learned cameras are taken and its picture
    settings, as far as the configuration does not say otherwise.

    Args:
        prepared: Files without labels are all drawn; of a data set `limit` shapes of `split`, each class in
            turn.
        config: What to draw, how, and where to.
        console: For progress.

    Yields:
        For each shape, once its pictures are written: `file`, `name`, `label`, `picture` (the sheet), and
        `views`, each with `azimuth_deg`, `elevation_deg`, `distance` and, with `per_view`, `picture`.

    Raises:
        DataError: There is no shape in the split.
    """
    announce_compilation(console)
    indices = chosen_shapes(prepared, config)
    settings = picture_settings(config)
    look = _learned_cameras(config) if _wants_learned(config) else None
    taken: set[str] = set()
    answers: list[dict[str, Any]] = []
    out = Path(config.out)
    with console.progress("drawing", len(indices)) as ticker:
        for begin in range(0, len(indices), AT_ONCE):
            chunk = indices[begin : begin + AT_ONCE]
            azimuth, elevation = look(prepared, chunk) if look else given_cameras(config, len(chunk), begin)
            images = draw_shapes(prepared, chunk, azimuth, elevation, settings)
            azimuth, elevation = standard_angles(azimuth, elevation)
            for row, index in enumerate(chunk):
                name = safe_name(prepared.records[index].name, taken)
                views = _views(azimuth[row], elevation[row], settings.distance)
                write_run_file(out / f"{name}.png", sheet(images[row], views, prepared.records[index].name))
                if getattr(config, "per_view", False):
                    _write_each(out, name, images[row], views)
                answers.append(_answer(prepared, index, out / f"{name}.png", views))
                yield answers[-1]
                ticker.advance()
    write_json(
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


def given_cameras(config: RenderViewsConfig, count: int, first: int = 0) -> tuple[Array, Array]:
    """Azimuth and elevation (count, M) of cameras that no network chooses.

    Own angles stand on a circle where only azimuths are named (at elevation 30°) or only elevations.
    `random` views are drawn for each shape from the seed and the shape's number, `first` onwards.
    """
    if config.views == "random":
        drawn = [layouts("random", config.num_views, seed=config.seed + first + i) for i in range(count)]
        return np.stack([a for a, _ in drawn]), np.stack([e for _, e in drawn])
    if config.azimuth or config.elevation:
        several = [len(x) for x in (config.azimuth or (), config.elevation or ()) if len(x) > 1]
        num_views = max(several) if several else 1 if config.azimuth else config.num_views
        azimuth, elevation = layouts("circular", num_views)
        azimuth = azimuth if config.azimuth is None else np.array(config.azimuth, dtype=float)
        elevation = elevation if config.elevation is None else np.array(config.elevation, dtype=float)
        azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    else:
        azimuth, elevation = layouts(config.layout, config.num_views)
    return np.tile(azimuth, (count, 1)), np.tile(elevation, (count, 1))


def picture_settings(config: RenderViewsConfig) -> Any:
    """How pictures are taken: as a named run does, but for what the configuration sets itself."""
    if config.run is None:
        return config
    from mvtn_cli.config import PictureConfig
    from mvtn_cli.core.training.run import Run

    own = {name for name in PictureConfig.model_fields if name in config.model_fields_set} | {"image_size"}
    return Run.open(config.run, config.runs).config.model_copy(update={name: getattr(config, name) for name in own})


def sheet(images: NDArray[np.uint8], views: Sequence[dict[str, Any]], title: str) -> bytes:
    """Lay the views (M, 3, H, W) of one shape out in rows of at most six, as even as they can be."""
    count = len(images)
    rows = -(-count // SHEET_COLUMNS)
    columns = -(-count // rows)
    blank = np.full((rows * columns - count, *images.shape[1:]), 252, np.uint8)
    captions = [f"{words.degrees(v['azimuth_deg'], 0)} / {words.degrees(v['elevation_deg'], 0)}" for v in views]
    captions += [""] * len(blank)
    grid = np.concatenate([images, blank]).reshape(rows, columns, *images.shape[1:])
    return contact_sheet(grid, captions=[captions[r * columns : (r + 1) * columns] for r in range(rows)], title=title)


def safe_name(name: str, taken: set[str]) -> str:
    """Turn a shape's name into that of a file that lies in its folder and is nobody else's.

    Args:
        name: Anything, e.g. `chair/chair_0001` or `../../etc/passwd`.
        taken: Names given so far, in lower case; the new one is added.
    """
    safe = re.sub(r"[^\w.-]+", "-", name.replace("\\", "/")).strip(".-")[:100].rstrip(".-") or "shape"
    if re.fullmatch(r"(?i)(con|prn|aux|nul|com\d|lpt\d|cameras)(\..*)?", safe):
        safe = f"shape-{safe}"
    unique, number = safe, 2
    while unique.lower() in taken:
        unique, number = f"{safe}-{number}", number + 1
    taken.add(unique.lower())
    return unique


def _wants_learned(config: RenderViewsConfig) -> bool:
    own = bool(config.azimuth or config.elevation)
    return config.run is not None and not own and (config.views is None or config.views.startswith("learned"))


def _learned_cameras(config: RenderViewsConfig) -> Any:
    """Load the run and return what says where its cameras stand for some shapes."""
    import torch

    from mvtn_cli.core.training.predict import load_model
    from mvtn_cli.core.training.randomness import evaluation_generator
    from mvtn_cli.core.training.run import Run
    from mvtn_cli.core.training.shapes import load_batch

    model = load_model(Run.open(str(config.run), config.runs), config.checkpoint, config.device)

    def look(prepared: Prepared, chunk: Sequence[int]) -> tuple[Array, Array]:
        batch, _ = load_batch(prepared, chunk, "points")
        with torch.no_grad():
            cameras = model.choose_cameras(batch, generator=evaluation_generator(config.seed, chunk[0]))
        return cameras.azimuth_deg.double().cpu().numpy(), cameras.elevation_deg.double().cpu().numpy()

    return look


def _views(azimuth: Array, elevation: Array, distance: float) -> list[dict[str, Any]]:
    return [
        {"azimuth_deg": round(float(a), 4), "elevation_deg": round(float(e), 4), "distance": float(distance)}
        for a, e in zip(azimuth, elevation, strict=True)
    ]


def _write_each(out: Path, name: str, images: NDArray[np.uint8], views: list[dict[str, Any]]) -> None:
    for number, (image, view) in enumerate(zip(images, views, strict=True), 1):
        path = out / name / f"view_{number:02d}.png"
        write_run_file(path, png(image))
        view["picture"] = str(path)


def _answer(prepared: Prepared, index: int, picture: Path, views: list[dict[str, Any]]) -> dict[str, Any]:
    record = prepared.records[index]
    label = prepared.classes[record.label] if 0 <= record.label < len(prepared.classes) else None
    return {
        "file": record.source,
        "name": record.name,
        "label": label,
        "picture": str(picture),
        "views": views,
    }
