"""One pydantic model a command: the only place with defaults, units and limits.

The descriptions here are the help texts of the options, so that the two can't differ. `commands/settings.py`
fills a model from option > environment > file > default and remembers which it was.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, Self, get_args

from pydantic import model_validator

from mvtn_cli.bench_config import BenchConfig, Names
from mvtn_cli.errors import UsageError, choose_error
from mvtn_cli.fields import Angles, Config, Supersample, option

Selection = Literal["fixed", "jittered", "random", "learned-direct", "learned-circular", "learned-spherical"]
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


class SkipConfig(Config):
    """For commands that draw: what a scene does not need is left out, and told on request."""

    no_skip: Names = option((), "Do not leave out: see docs/skips.md", "Machine", metavar="NAME", many=True)
    explain: bool = option(False, "Say what was left out for these shapes and views, and why", "Answer")


class PreprocessConfig(ShapesConfig):
    """From files to stored shapes."""

    dataset: str | None = option(
        None,
        "builtin:shapes, builtin:one-sided, modelnet40:PATH, modelnet10:PATH, shapenet55:PATH, "
        "scanobjectnn:PATH[@VARIANT], folder:PATH or a path; "
        "auto: the one in mvtn.toml, else the last one preprocessed here, else builtin:shapes",
        "Data",
        argument=True,
    )
    on_bad: Literal["fail", "skip"] = option(
        "fail", "Unusable files: fail (do all others, then exit with 1) or skip (warn, exit with 0)", "Data"
    )
    max_vertices: int = option(20_000, "Simplify meshes with more vertices", "Data", ge=16, le=10_000_000)
    num_points: int = option(2048, "Points sampled on each surface and stored", "Data", ge=16, le=1_000_000)
    seed: int = option(0, "Seed of the point samples", "Data", ge=0, le=2**32 - 1)
    explain_layout: bool = option(
        False, "Print the expected tree of DATASET, or of each kind, and where people get it; do nothing else", "Data"
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
            values["views"] = _learned(layout)
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


class TrainConfig(LayoutConfig, PictureConfig, RunsConfig, MachineConfig):
    """A training: what `config.toml` of a run holds."""

    dataset: str | None = option(
        None,
        "As for preprocess; auto: the one in mvtn.toml, else the last preprocessed here, else builtin:shapes",
        "Data",
        argument=True,
    )
    train_limit: int | None = option(None, "Use only this many training shapes, drawn by seed", "Data", ge=1)
    val_fraction: float = option(
        0.1, "Share of each class for validation; 0: none, the last epoch is taken", "Data", ge=0, lt=1
    )

    views: Selection = option(
        "learned-spherical",
        "How cameras are chosen; learned: learned-spherical or learned-circular, after --layout",
        "Views",
        also=("learned",),
    )
    angles: Literal["periodic", "tanh"] = option(
        "periodic", "Form of learned-direct angles: periodic has no dead ends, tanh is the paper's", "Views"
    )
    explore: float | None = option(
        None,
        "Noise on learned views in training, degrees, falling to 0; auto: 45, offset views half their reach",
        "Views",
        ge=0,
        le=180,
    )
    azimuth: float = option(0.0, "Of the first view, degrees", "Views", ge=-360, le=360)
    elevation: float = option(30.0, "Of a circle or a single view, degrees", "Views", ge=-90, le=90)

    color: Literal["mixed", "random", "white"] = option(
        "mixed", "Colour in training: half of the shapes, all, or none coloured; evaluation is white", "Pictures"
    )
    light: Literal["mixed", "random", "headlight"] = option(
        "mixed", "Light in training: half of the shapes, all, or none from aside; evaluation: headlight", "Pictures"
    )
    gradient: Literal["edge-flow", "shading", "fd", "none"] = option(
        "edge-flow",
        "From picture to camera: edge-flow, fd (central differences); ablations: shading (no silhouettes), none",
        "Pictures",
    )
    fd_step: float = option(1.0, "Step of --gradient fd, degrees", "Pictures", ge=0.05, le=20)
    allow_no_gradient: bool = option(False, "Allow learned views with --gradient none", "Pictures")

    backbone: str = option("tiny", "tiny (3 convolutions) or a torchvision classifier: resnet18", "Network")
    weights: str = option("none", "Of the backbone: none, imagenet or a .safetensors or .pth file", "Network")
    freeze_backbone: bool = option(False, "Train only what comes after the backbone", "Network")
    backbone_lr_scale: float = option(1.0, "Backbone's learning rate, times --lr", "Network", ge=0, le=10)
    pool: Literal["max", "mean"] = option("max", "How the views' features become one", "Network")
    encoder_points: int = option(512, "Points that the point network sees", "Network", ge=8, le=100_000)

    epochs: int = option(30, "Passes over the training shapes", "Training", ge=1, le=100_000)
    batch_size: int = option(32, "Shapes a step", "Training", ge=1, le=4096)
    lr: float = option(3e-3, "Highest learning rate of the classifier", "Training", gt=0, le=10)
    views_lr: float = option(5e-4, "Highest learning rate of the viewpoint network", "Training", ge=0, le=10)
    weight_decay: float = option(0.01, "Of AdamW", "Training", ge=0, le=10)
    clip: float = option(30.0, "Largest gradient norm of the viewpoint network in a step", "Training", gt=0)
    label_smoothing: float = option(0.0, "Share of the target given to all classes", "Training", ge=0, lt=1)
    select: Literal["val", "test"] = option(
        "val", "Split that chooses the best epoch; test is the paper's habit, named in the report", "Training"
    )
    seed: int = option(0, "Seed of everything random", "Training", ge=0, le=2**32 - 1)
    max_bad_steps: int = option(10, "Stop after so many steps without finite gradient", "Training", ge=1)

    name: str | None = option(
        None,
        "Name of the run's folder; auto: made from the settings",
        "Run",
        pattern=r"^[A-Za-z0-9_][\w.+-]*$",
        words="letters, digits and _ . + - only",
    )

    @model_validator(mode="after")
    def _check_combinations(self) -> TrainConfig:
        learned = self.views.startswith("learned")
        if learned and self.gradient == "none" and not self.allow_no_gradient:
            raise UsageError(
                f"with --gradient none the pictures can't teach {self.views} views",
                hint="use --gradient edge-flow, or add --allow-no-gradient for an ablation",
                code="train.no-gradient",
            )
        if self.angles == "tanh" and learned and self.views != "learned-direct":
            raise UsageError(
                f"--angles tanh belongs to --views learned-direct, not to {self.views}",
                hint="add --views learned-direct, or leave --angles out",
                code="train.angles",
            )
        return self


class TrainOptions(TrainConfig, SkipConfig):
    """`mvtn train`: a training, or several that are compared."""

    compare: str | None = option(
        None,
        "Instead of --views: train with each of these and compare, as fixed,jittered,learned",
        "Compare",
        metavar="LIST",
    )
    seeds: int = option(3, "Trainings of each selection in a comparison", "Compare", ge=2, le=100)

    @model_validator(mode="before")
    @classmethod
    def _views_of_comparison(cls, values: Any) -> Any:
        if not isinstance(values, dict) or values.get("compare") in (None, "auto"):
            return values
        names = _selections(values["compare"], values.get("layout"))
        # The one that --angles is about, if it takes part: a common setting must be valid for somebody.
        return {**values, "views": "learned-direct" if "learned-direct" in names else names[0]}

    def training(self) -> TrainConfig:
        """The settings of one training, or those that all trainings of a comparison share."""
        return TrainConfig.model_validate(self.model_dump(exclude={"compare", "seeds", "no_skip", "explain"}))

    def selections(self) -> list[str]:
        """The view selections to compare, in full words; empty without `--compare`."""
        return _selections(self.compare, self.layout) if self.compare else []


class FilesConfig(Config):
    """For commands that take single files."""

    up: Literal["y", "z"] | None = option(
        None, "Axis that points up in the files; auto: as in the run's data set, else y", "Data"
    )
    on_bad: Literal["fail", "skip"] = option(
        "fail", "Unusable files: fail (answer all others, then exit with 1) or skip (exit with 0)", "Data"
    )


class EvalConfig(RunsConfig, MachineConfig, SkipConfig):
    """What to measure of a finished training."""

    run: str | None = option(None, "Run folder or its name; auto: the latest run", "Run", argument=True)
    split: Literal["test", "val", "train"] = option("test", "Shapes to measure on", "Data")
    checkpoint: Literal["best", "last"] = option("best", "Weights to use", "Run")
    baseline: bool = option(False, "Also measure a random forest on distance histograms", "Measure")
    seed: int = option(0, "Seed of the random forest", "Measure", ge=0, le=2**32 - 1)
    batch_size: int = option(32, "Shapes a step", "Machine", ge=1, le=4096)
    out: Path | None = option(None, "For tables and report; auto: the run", "Run", metavar="DIR", short="-o")


class PredictConfig(FilesConfig, RunsConfig, MachineConfig):
    """Classes of single files."""

    files: tuple[str, ...] = option(
        (),
        "Meshes, point clouds, folders or globs; - reads names from standard input",
        "Data",
        argument="many",
    )
    run: str | None = option(None, "Run folder or its name; auto: the latest run", "Run")
    checkpoint: Literal["best", "last"] = option("best", "Weights to use", "Run")
    top: int = option(1, "Classes to name for each file, likeliest first", "Answer", ge=1, le=1000)
    batch_size: int = option(16, "Files a step; answers come after each", "Machine", ge=1, le=4096)


class RenderViewsConfig(FilesConfig, LayoutConfig, PictureConfig, RunsConfig, MachineConfig):
    """Contact sheets of the views of shapes."""

    files: tuple[str, ...] = option(
        (),
        "Meshes, point clouds, globs, a data set or a run folder; - reads names from standard input",
        "Data",
        argument="many",
    )
    image_size: int = option(128, "Width and height of a view, pixels", "Pictures", ge=8, le=1024)
    limit: int = option(16, "Shapes of a data set or run to draw", "Data", ge=1, le=100_000)
    split: Literal["test", "val", "train"] = option("test", "Shapes of a data set or run to draw", "Data")
    run: str | None = option(None, "Run whose learned cameras are used", "Run")
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
    seed: int = option(0, "Seed of random views", "Views", ge=0, le=2**32 - 1)
    per_view: bool = option(False, "Also write each view as a picture of its own", "Answer")
    out: Path = option(Path("views"), "Folder for the pictures", "Answer", metavar="DIR", short="-o")

    @model_validator(mode="after")
    def _check_combinations(self) -> RenderViewsConfig:
        azimuths, elevations = len(self.azimuth or ()), len(self.elevation or ())
        if azimuths > 1 and elevations > 1 and azimuths != elevations:
            raise UsageError(
                f"--azimuth names {azimuths} cameras and --elevation {elevations}",
                hint="give as many of both, or one elevation for all",
                code="render-views.angles",
            )
        return self


class CacheConfig(CachedConfig):
    """What lies in the artifact directory."""

    action: Literal["show", "clear"] = option("show", "show sizes, or clear", "Cache", argument=True)
    kind: Literal["shapes", "datasets", "views", "descriptors"] | None = option(
        None, "Only this kind of artifact; auto: all", "Cache"
    )
    yes: bool = option(False, "Really clear", "Cache")


class DoctorConfig(RunsConfig, ShapesConfig):
    """What to look at on this machine, or of a data set."""

    # Not `dataset`: that may stand in mvtn.toml, and a bare `mvtn doctor` is about the machine.
    data: str | None = option(
        None, "Data set to examine, as for preprocess; auto: this machine instead", "Data", argument=True
    )


MODELS: dict[str, type[Config]] = {
    "preprocess": PreprocessConfig,
    "train": TrainOptions,
    "eval": EvalConfig,
    "render-views": RenderViewsConfig,
    "predict": PredictConfig,
    "bench": BenchConfig,
    "cache": CacheConfig,
    "doctor": DoctorConfig,
}


def _learned(layout: Any) -> str:
    """The selection that the word `learned` means."""
    if layout not in ("circular", "spherical"):
        raise UsageError(
            f"there are no learned {layout} views",
            hint="use --layout spherical or circular, or --views learned-direct",
            code="views.layout",
        )
    return f"learned-{layout}"


def _selections(listed: str, layout: Any) -> list[str]:
    """Read the list of a comparison into full words."""
    names = [name.strip() for name in listed.split(",") if name.strip()]
    for name in names:
        if name not in (*SELECTIONS, "learned"):
            raise choose_error("views", name, (*SELECTIONS, "learned"))
    selections = [_learned(layout or "spherical") if name == "learned" else name for name in names]
    if len(set(selections)) < max(2, len(names)):
        raise UsageError(
            f"--compare needs two or more different selections, got '{listed}'",
            hint="for example --compare fixed,jittered,learned",
        )
    return selections
