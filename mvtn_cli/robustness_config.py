"""Settings of `mvtn robustness`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from mvtn_cli.fields import option, several
from mvtn_cli.shared_config import ClusterConfig, MachineConfig, RunsConfig, SkipConfig, StepsConfig


def _in_full(value: Any) -> Any:
    """A bare `x` is `+x`."""
    words = several(value)
    if not isinstance(words, list | tuple):
        return words
    return [f"+{word}" if word in ("x", "y", "z") else word for word in words]


def _one_or_several(value: Any) -> Any:
    """One name, as a file or the environment gives it, is a list of one; names are not split at commas."""
    return (value,) if isinstance(value, str) else value


Share = Annotated[float, Field(ge=0, lt=1)]
Shares = Annotated[tuple[Share, ...], BeforeValidator(several), Field(min_length=1, max_length=100)]
Limits = Annotated[
    tuple[Annotated[float, Field(gt=0, le=180)], ...],
    BeforeValidator(several),
    Field(min_length=1, max_length=100),
]
Radii = Annotated[
    tuple[Annotated[float, Field(ge=0, le=1)], ...],
    BeforeValidator(several),
    Field(min_length=1, max_length=100),
]
Factors = Annotated[
    tuple[Annotated[float, Field(gt=0, le=2)], ...],
    BeforeValidator(several),
    Field(min_length=1, max_length=100),
]
Directions = Annotated[tuple[Literal["+x", "-x", "+y", "-y", "+z", "-z"], ...], BeforeValidator(_in_full)]
PAPER_ROTATE, PAPER_OCCLUDE = (90.0, 180.0), (0.1, 0.2, 0.3, 0.5, 0.75)


class RobustnessConfig(RunsConfig, MachineConfig, ClusterConfig, StepsConfig, SkipConfig):
    """What is done to the test shapes before runs have to recognise them."""

    run: Annotated[tuple[str, ...], BeforeValidator(_one_or_several)] = option(
        (),
        "Run folders or their names, which become the rows of a table; auto: the latest run",
        "Run",
        argument="many",
        names="runs",
    )
    checkpoint: Literal["best", "last"] = option("best", "Weights to use", "Run")
    rotate: Limits | None = option(
        None, "Turn about the up axis by up to so many degrees, as 90,180; auto: those, if nothing is asked for",
        "Measure", metavar="LIST",
    )  # fmt: skip
    so3: bool = option(False, "Turn any way, uniformly", "Measure")
    occlude: Shares | None = option(
        None, "Take such shares of a shape away; auto: 0.1,0.2,0.3,0.5,0.75, if nothing is asked for",
        "Measure", metavar="LIST",
    )  # fmt: skip
    directions: Directions = option(
        (), "Sides that occlusion takes away, as +x,-y; none named: all six", "Measure", metavar="LIST"
    )
    crop: Literal["quantile", "extent", "cube"] = option(
        "quantile",
        "What a share is of; quantile: stored points; extent: the shape's box; cube: [-1, 1], as the paper's code",
        "Measure",
    )
    noise: Radii | None = option(
        None, "Move points and vertices by normal noise of such deviations, shape radii", "Measure", metavar="LIST"
    )
    drop_points: Shares | None = option(None, "Remove such shares of the points by chance", "Measure", metavar="LIST")
    scale: Factors | None = option(None, "Make shapes so many times as large", "Measure", metavar="LIST")
    repeats: int = option(10, "Evaluations of each corruption that chance has a part in", "Measure", ge=1, le=1000)
    seed: int = option(0, "Seed of the corruptions, of --limit and of random views", "Measure", ge=0, le=2**32 - 1)
    limit: int | None = option(
        None, "Use only this many test shapes, as many of each class as can be; auto: all", "Data", ge=1
    )
    out: Path | None = option(
        None, "For table and plots; auto: the run, for several runs RUNS/robustness", "Run", metavar="DIR", short="-o"
    )

    @property
    def asks_for_nothing(self) -> bool:
        """Whether no corruption is named: then it is the paper's."""
        lists = (self.rotate, self.occlude, self.noise, self.drop_points, self.scale)
        return not self.so3 and all(strengths is None for strengths in lists)
