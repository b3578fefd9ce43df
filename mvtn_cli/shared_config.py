"""What the settings of several commands have in common; each command's own are in `config.py` and its neighbours."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, Self, get_args

from pydantic import model_validator

from mvtn_cli.bench_config import Names
from mvtn_cli.errors import UsageError
from mvtn_cli.fields import Config, Supersample, option

Selection = Literal[
    "fixed", "jittered", "random", "transferred", "learned-random", "learned-direct", "learned-circular",
    "learned-spherical",
]  # fmt: skip
Layout = Literal["circular", "spherical", "dodecahedral", "icosahedral"]
SELECTIONS: tuple[str, ...] = get_args(Selection)
DEVICES = "auto, cpu, cuda, cuda:N or mps"
SOLIDS = {"dodecahedral": 20, "icosahedral": 12}  # layouts whose number of views is given by their corners


class CachedConfig(Config):
    """For commands that touch the artifact directory."""

    cache: Path | None = option(None, "Artifact directory; auto: the user's", "Machine", metavar="DIR")


class RunsConfig(Config):
    """For commands that touch the folder of runs."""

    runs: Path = option(Path("runs"), "Folder of all runs", "Run", metavar="DIR")


class ShapesConfig(CachedConfig):
    """For commands that prepare shapes."""

    workers: int | None = option(None, "Processes; auto: one a core", "Machine", ge=1, le=1024, short="-j")


class ClusterConfig(Config):
    """For commands whose work can go to many machines."""

    scheduler: str | None = option(
        None,
        "Send the work to the Dask cluster of this scheduler, as tcp://host:8786 (needs the extra cluster)",
        "Machine",
        metavar="ADDRESS",
        pattern=r"^(tcp|tls)://[^/\s]+:\d+$",
        words="an address as tcp://host:8786",
    )


class MachineConfig(ShapesConfig):
    """Where and with what a command works."""

    device: str = option(
        "auto",
        f"Where networks run: {DEVICES}",
        "Machine",
        pattern=r"^(auto|cpu|cuda(:\d+)?|mps)$",
        words=DEVICES,
    )
    threads: int | None = option(None, "CPU threads; auto: all cores", "Machine", ge=1, le=1024)


class StepsConfig(Config):
    """For commands that take shapes in steps; how many at a time matters only where views are random."""

    batch_size: int | None = option(
        32, "Shapes a step; auto: as many as in the run's training", "Machine", ge=1, le=4096, auto=True
    )

    def shapes_a_step(self, of_training: int) -> int:
        """How many, where the training had `of_training`."""
        return self.batch_size or of_training


class SkipConfig(Config):
    """For commands that draw: what a scene does not need is left out, and told on request."""

    no_skip: Names = option((), "Do not leave out: see docs/skips.md", "Machine", metavar="NAME", many=True)
    explain: bool = option(False, "Say what was left out for these shapes and views, and why", "Answer")


class FilesConfig(Config):
    """For commands that take single files."""

    up: Literal["y", "z"] | None = option(
        None, "Axis that points up in the files; auto: as in the run's data set, else y", "Data"
    )
    on_bad: Literal["fail", "skip"] = option(
        "fail", "Unusable files: fail (answer all others, then exit with 1) or skip (exit with 0)", "Data"
    )


class PictureConfig(Config):
    """How a picture of a shape is taken, apart from where the camera stands."""

    image_size: int = option(64, "Width and height of a view, pixels", "Pictures", ge=8, le=1024)
    distance: float = option(2.2, "From camera to shape's centre, shape radii", "Pictures", gt=1, le=100)
    fov: float = option(60.0, "Vertical field of view, degrees", "Pictures", ge=1, le=150)
    look: Literal["studio", "relief", "paper"] = option(
        "studio", "Light: studio: soft; relief: steep; paper: as published, white behind meshes", "Pictures"
    )
    render: Literal["auto", "mesh", "points"] = option(
        "auto", "Draw meshes or points; auto: meshes where a shape has one", "Pictures"
    )
    shading: Literal["smooth", "flat"] = option("smooth", "Normals per vertex or per face", "Pictures")
    supersample: Supersample = option(1, "Samples a pixel in each direction", "Pictures", metavar="1|2|4")
    depth_cue: float = option(
        0.8,
        "Share of its light that a drawn point loses from the near to the far side; none with --look paper",
        "Pictures",
        ge=0,
        le=1,
    )
    point_radius: float = option(0.02, "Radius of a drawn point, shape radii", "Pictures", ge=0.001, le=0.5)


class LayoutConfig(Config):
    """How many cameras there are, and where they stand before anything is learned."""

    layout: Layout = option("spherical", "Where fixed cameras stand, and learned ones start", "Views")
    num_views: int = option(6, "Views of each shape", "Views", ge=1, le=100)

    @model_validator(mode="before")
    @classmethod
    def _fill_from_layout(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        values, layout = dict(values), values.get("layout", "spherical")
        if values.get("views") == "learned":
            values["views"] = learned_selection(layout)
        if layout in SOLIDS:
            values.setdefault("num_views", SOLIDS[layout])
        return values

    @model_validator(mode="after")
    def _check_layout(self) -> Self:
        corners = SOLIDS.get(self.layout, self.num_views)
        if self.num_views != corners:
            raise UsageError(
                f"the {self.layout} layout has {corners} views, not {self.num_views}",
                hint=f"use --num-views {corners}, or --layout spherical for any number",
                code="views.layout",
            )
        return self


def learned_selection(layout: Any) -> str:
    """The selection that the word `learned` means."""
    if layout not in ("circular", "spherical"):
        raise UsageError(
            f"there are no learned {layout} views",
            hint="use --layout spherical or circular, or --views learned-direct",
            code="views.layout",
        )
    return f"learned-{layout}"
