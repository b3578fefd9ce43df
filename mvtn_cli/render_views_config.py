"""Settings of `mvtn render-views`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, model_validator

from mvtn_cli.errors import UsageError
from mvtn_cli.fields import Angles, option, several
from mvtn_cli.shared_config import FilesConfig, LayoutConfig, MachineConfig, PictureConfig, RunsConfig, Selection

Outputs = Annotated[
    tuple[Literal["silhouette", "depth", "normals", "arrays"], ...],
    BeforeValidator(several),
]


class RenderViewsConfig(FilesConfig, LayoutConfig, PictureConfig, RunsConfig, MachineConfig):
    """Pictures of the views of shapes: contact sheets, and on request everything else that a camera gives."""

    files: tuple[str, ...] = option(
        (),
        "Meshes, point clouds, globs, a data set or a run folder; - reads names from standard input",
        "Data",
        argument="many",
    )
    image_size: int = option(128, "Width and height of a view, pixels", "Pictures", ge=8, le=1024)
    limit: int = option(16, "Shapes of a data set or run to draw", "Data", ge=1, le=100_000)
    split: Literal["test", "val", "train"] = option("test", "Shapes of a data set or run to draw", "Data")
    run: str | None = option(None, "Run whose learned cameras are used", "Run", names="runs")
    checkpoint: Literal["best", "last"] = option("best", "Weights of the run", "Run")
    views: Selection | None = option(
        None,
        "How cameras are chosen; auto: as in --run, else fixed; learned: as in --run, else the latest run",
        "Views",
        also=("learned",),
    )
    azimuth: Angles | None = option(
        None, "Azimuths of own cameras, degrees, as 0,90,180; auto: after the layout", "Views", metavar="LIST"
    )
    elevation: Angles | None = option(
        None,
        "Elevations of own cameras, or one for all, degrees; auto: after the layout",
        "Views",
        metavar="LIST",
    )
    cameras_from: Path | None = option(
        None,
        "Cameras and picture settings of a transforms.json, instead of a layout",
        "Views",
        metavar="FILE",
    )
    seed: int = option(0, "Seed of random views", "Views", ge=0, le=2**32 - 1)
    per_view: bool = option(False, "Also write each view as a picture of its own", "Answer")
    outputs: Outputs = option(
        (),
        "More to write of each view, as depth,normals; arrays is all of it in one .npz, without loss",
        "Answer",
        metavar="LIST",
    )
    cameras: bool = option(
        False, "Also write views, cameras.json, transforms.json and a picture of where the cameras stand", "Answer"
    )
    turntable: bool = option(False, "Also write an animated GIF of a turn around each shape", "Answer")
    out: Path = option(Path("views"), "Folder for the pictures", "Answer", metavar="DIR", short="-o")

    @property
    def asks_a_network(self) -> bool:
        """Whether `views` are such as only the network of a run can say."""
        return self.views is not None and (self.views.startswith("learned") or self.views == "transferred")

    @model_validator(mode="after")
    def _check_outputs(self) -> RenderViewsConfig:
        if self.render == "points" and "normals" in self.outputs:
            raise UsageError(
                "points have no normals to draw",
                hint="leave normals out of --outputs, or --render points away",
                code="render-views.outputs",
            )
        return self

    @model_validator(mode="after")
    def _check_combinations(self) -> RenderViewsConfig:
        if self.cameras_from is not None and (self.azimuth or self.elevation):
            raise UsageError(
                "--cameras-from names the cameras already; --azimuth and --elevation would name others",
                hint="leave one of them out",
                code="render-views.angles",
            )
        azimuths, elevations = len(self.azimuth or ()), len(self.elevation or ())
        if azimuths > 1 and elevations > 1 and azimuths != elevations:
            raise UsageError(
                f"--azimuth names {azimuths} cameras and --elevation {elevations}",
                hint="give as many of both, or one elevation for all",
                code="render-views.angles",
            )
        return self
