"""One pydantic model a command: the only place with defaults, units and limits.

The descriptions here are the help texts of the options, so that the two can't differ. `commands/settings.py`
fills a model from option > environment > file > preset > default and remembers which it was.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import model_validator

from mvtn_cli.bench_config import BenchConfig
from mvtn_cli.errors import UsageError, choose_error
from mvtn_cli.export_config import ExportConfig
from mvtn_cli.fields import Config, option
from mvtn_cli.network_config import NetworkConfig
from mvtn_cli.presets_config import PresetConfig, PresetsConfig
from mvtn_cli.render_views_config import RenderViewsConfig
from mvtn_cli.report_config import ReportConfig
from mvtn_cli.retrieve_config import RetrieveConfig
from mvtn_cli.robustness_config import RobustnessConfig
from mvtn_cli.shared_config import (
    SELECTIONS,
    CachedConfig,
    ClusterConfig,
    FilesConfig,
    LayoutConfig,
    MachineConfig,
    PictureConfig,
    RunsConfig,
    Selection,
    ShapesConfig,
    SkipConfig,
    StepsConfig,
    learned_selection,
)
from mvtn_cli.sweep_config import VaryConfig


class PreprocessConfig(ShapesConfig, ClusterConfig):
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


class TrainConfig(LayoutConfig, PictureConfig, NetworkConfig, RunsConfig, MachineConfig):
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
    views_from: str | None = option(
        None,
        "Run whose viewpoint network is taken as it is, for --views transferred",
        "Views",
        metavar="RUN",
        names="runs",
    )
    learn_distance: float = option(
        1.0, "Let learned views also choose their distance, up to this factor; 1: no", "Views", ge=1, le=10
    )
    learn_light: bool = option(False, "Let the viewpoint network also choose the light", "Views")
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
    precision: Literal["auto", "float32", "bf16"] = option(
        "auto",
        "Of the networks in training, bf16: mixed; auto: bf16 on GPUs that have it, else float32; cameras: float32",
        "Training",
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
    log: Literal["none", "tensorboard"] = option(
        "none", "Also write TensorBoard's event files, in RUN/tensorboard (needs the extra of that name)", "Run"
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
        if (self.views == "transferred") != (self.views_from is not None):
            raise UsageError(
                "--views transferred and --views-from RUN belong together",
                hint="name the run whose viewpoint network is to be taken, or choose other --views",
                code="train.views-from",
            )
        if self.angles == "tanh" and learned and self.views != "learned-direct":
            raise UsageError(
                f"--angles tanh belongs to --views learned-direct, not to {self.views}",
                hint="add --views learned-direct, or leave --angles out",
                code="train.angles",
            )
        return self


class OpenTraining(TrainConfig):
    """A training whose batch size may have to be worked out when the data set is known."""

    batch_size: int | None = option(  # type: ignore[assignment]
        32,
        "Shapes a step; auto: a power of two that fits into memory, up to 32, or up to 256 where epochs are long",
        "Training",
        ge=1,
        le=4096,
        auto=True,
    )

    def training(self) -> TrainConfig:
        """The settings of one training, or what several have in common; a batch size that is open is the default."""
        wanted = set(TrainConfig.model_fields) - ({"batch_size"} if self.batch_size is None else set())
        return TrainConfig.model_validate(self.model_dump(include=wanted))


class TrainOptions(OpenTraining, PresetConfig, SkipConfig):
    """`mvtn train`: a training, or several that are compared."""

    compare: str | None = option(
        None,
        "Instead of --views: train with each of these and compare, as fixed,jittered,learned",
        "Compare",
        metavar="LIST",
    )
    seeds: int = option(3, "Trainings of each selection in a comparison", "Compare", ge=2, le=100)
    devices: int = option(
        1, "Processes that train together, each on a GPU of its own or its share of the cores", "Machine", ge=1, le=1024
    )

    @model_validator(mode="before")
    @classmethod
    def _views_of_comparison(cls, values: Any) -> Any:
        if not isinstance(values, dict) or values.get("compare") in (None, "auto"):
            return values
        names = _selections(values["compare"], values.get("layout"))
        # The one that --angles is about, if it takes part: a common setting must be valid for somebody.
        return {**values, "views": "learned-direct" if "learned-direct" in names else names[0]}

    def selections(self) -> list[str]:
        """The view selections to compare, in full words; empty without `--compare`."""
        return _selections(self.compare, self.layout) if self.compare else []


class SweepConfig(OpenTraining, VaryConfig, PresetConfig, SkipConfig):
    """`mvtn sweep`: trainings that differ in a few settings."""


class EvalConfig(RunsConfig, MachineConfig, StepsConfig, SkipConfig):
    """What to measure of a finished training."""

    run: str | None = option(None, "Run folder or its name; auto: the latest run", "Run", argument=True, names="runs")
    split: Literal["test", "val", "train"] = option("test", "Shapes to measure on", "Data")
    checkpoint: Literal["best", "last"] = option("best", "Weights to use", "Run")
    baseline: bool = option(False, "Also measure a random forest on distance histograms", "Measure")
    view_analysis: bool = option(
        False, "Also measure what learned views are worth, and how much of the class they give away", "Measure"
    )
    seed: int = option(0, "Seed of the random forests", "Measure", ge=0, le=2**32 - 1)
    out: Path | None = option(None, "For tables and report; auto: the run", "Run", metavar="DIR", short="-o")


class PredictConfig(FilesConfig, RunsConfig, MachineConfig, StepsConfig):
    """Classes of single files."""

    files: tuple[str, ...] = option(
        (),
        "Meshes, point clouds, folders or globs; - reads names from standard input",
        "Data",
        argument="many",
    )
    run: str | None = option(None, "Run folder or its name; auto: the latest run", "Run", names="runs")
    checkpoint: Literal["best", "last"] = option("best", "Weights to use", "Run")
    top: int = option(1, "Classes to name for each file, likeliest first", "Answer", ge=1, le=1000)
    batch_size: int | None = option(
        16,
        "Files a step; answers come after each; auto: as many as in the run's training",
        "Machine",
        ge=1,
        le=4096,
        auto=True,
    )


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
    "sweep": SweepConfig,
    "presets": PresetsConfig,
    "eval": EvalConfig,
    "report": ReportConfig,
    "robustness": RobustnessConfig,
    "render-views": RenderViewsConfig,
    "retrieve": RetrieveConfig,
    "predict": PredictConfig,
    "export": ExportConfig,
    "bench": BenchConfig,
    "cache": CacheConfig,
    "doctor": DoctorConfig,
}


def _selections(listed: str, layout: Any) -> list[str]:
    """Read the list of a comparison into full words."""
    names = [name.strip() for name in listed.split(",") if name.strip()]
    for name in names:
        if name not in (*SELECTIONS, "learned"):
            raise choose_error("views", name, (*SELECTIONS, "learned"))
    selections = [learned_selection(layout or "spherical") if name == "learned" else name for name in names]
    if len(set(selections)) < max(2, len(names)):
        raise UsageError(
            f"--compare needs two or more different selections, got '{listed}'",
            hint="for example --compare fixed,jittered,learned",
        )
    return selections
