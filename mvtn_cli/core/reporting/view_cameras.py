"""Where the cameras of `render-views` stand: on a layout, at given angles, as in a file, or as a run learned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from mvtn_cli.core.reporting.camera_files import CameraFile, as_drawn, read_transforms
from mvtn_cli.core.views import Cameras, layouts
from mvtn_cli.errors import DataError

if TYPE_CHECKING:
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.render_views_config import RenderViewsConfig

Array = NDArray[np.float64]


class Placed(NamedTuple):
    """Cameras of B shapes, and where a run learned it, the light of each view.

    Attributes:
        cameras: (B, M), angles within [-180, 180).
        light: (B, M, 3) unit vectors towards the light, world frame; None is a headlight.
    """

    cameras: Cameras
    light: torch.Tensor | None = None


Place = Callable[["Prepared", Sequence[int], int], Placed]


def view_settings(config: RenderViewsConfig) -> tuple[Place, Any]:
    """Decide where cameras stand and how pictures are taken.

    What the configuration sets itself goes before what the file of cameras says, and that before the run's.

    Returns:
        A function from a data set, some of its indices, and how many shapes were before, to their cameras; and
        the settings of pictures.

    Raises:
        DataError: The file of cameras can't be used, or the run takes no pictures.
    """
    from_file = read_transforms(Path(config.cameras_from)) if config.cameras_from is not None else None
    settings = picture_settings(config, from_file)
    if from_file is not None:
        return _place_as_in(config, from_file, settings), settings
    if config.run is not None and _wants_learned(config):
        return _place_as_learned(config, settings), settings

    def place(prepared: Prepared, chunk: Sequence[int], before: int) -> Placed:
        azimuth, elevation = map(torch.from_numpy, given_cameras(config, len(chunk), before))
        cameras = Cameras.at(azimuth, elevation, settings.distance, fov_deg=settings.fov)
        return Placed(as_drawn(cameras))

    return place, settings


def picture_settings(config: RenderViewsConfig, from_file: CameraFile | None = None) -> Any:
    """How pictures are taken: as a named run does, or a file of cameras, but for what the configuration sets."""
    from mvtn_cli.shared_config import PictureConfig

    own = {name: getattr(config, name) for name in PictureConfig.model_fields if name in config.model_fields_set}
    own.setdefault("image_size", config.image_size)
    settings: Any = config
    if config.run is not None:
        from mvtn_cli.core.training.run import Run

        settings = Run.open(config.run, config.runs).config
    if from_file is not None:
        theirs = {"fov": from_file.cameras.fov_deg, "image_size": from_file.image_size or config.image_size}
        checked = _checked(config, theirs | from_file.picture)
        own = checked | {name: value for name, value in own.items() if name in config.model_fields_set}
    return settings.model_copy(update=own)


def _checked(config: RenderViewsConfig, theirs: dict[str, Any]) -> dict[str, Any]:
    """Settings of a file, within the limits that options have."""
    from pydantic import ValidationError

    from mvtn_cli.shared_config import PictureConfig

    try:
        checked = PictureConfig.model_validate(theirs)
    except ValidationError as error:
        first = error.errors()[0]
        words = str(first["msg"])
        raise DataError(
            f"{config.cameras_from} has {first['loc'][0]} = {first['input']}: {words[0].lower()}{words[1:]}",
            code="cameras.file",
        ) from None
    return {name: getattr(checked, name) for name in theirs}


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


def _place_as_in(config: RenderViewsConfig, file: CameraFile, settings: Any) -> Place:
    """The cameras of a file, for every shape."""
    drawn = replace(_at_own_distance(config, file.cameras), fov_deg=settings.fov)

    def place(prepared: Prepared, chunk: Sequence[int], before: int) -> Placed:
        light = None if file.light is None else file.light.expand(len(chunk), -1, -1)
        return Placed(drawn.select(shapes=[0] * len(chunk)), light)

    return place


def _wants_learned(config: RenderViewsConfig) -> bool:
    own = bool(config.azimuth or config.elevation)
    return not own and (config.views is None or config.asks_a_network)


def _place_as_learned(config: RenderViewsConfig, settings: Any) -> Place:
    """Load the run; its network says where the cameras stand."""
    from mvtn_cli.core.training.predict import load_model
    from mvtn_cli.core.training.randomness import evaluation_generator
    from mvtn_cli.core.training.run import Run
    from mvtn_cli.core.training.shapes import load_batch

    model = load_model(Run.open(str(config.run), config.runs), config.checkpoint, config.device)
    if not model.uses_views:
        raise DataError(
            f"{config.run} looks at points and takes no pictures",
            hint="choose another --run, or cameras of your own: --layout, --azimuth, --elevation",
            code="render-views.run",
        )

    def place(prepared: Prepared, chunk: Sequence[int], before: int) -> Placed:
        batch, _ = load_batch(prepared, chunk, "points")
        with torch.no_grad():
            cameras, light = model.place(batch, generator=evaluation_generator(config.seed, chunk[0]))
        placed = _at_own_distance(config, cameras)
        return Placed(as_drawn(replace(placed, fov_deg=settings.fov)), light)

    return place


def _at_own_distance(config: RenderViewsConfig, cameras: Cameras) -> Cameras:
    """Cameras as far away as `--distance` says, where that is said."""
    if "distance" not in config.model_fields_set:
        return cameras
    return replace(cameras, distance=torch.full_like(cameras.distance, config.distance))
