"""Settings of `mvtn retrieve`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from mvtn_cli.errors import UsageError
from mvtn_cli.fields import option, several
from mvtn_cli.shared_config import ClusterConfig, FilesConfig, MachineConfig, RunsConfig, SkipConfig, StepsConfig

Cuts = Annotated[tuple[Annotated[int, Field(ge=1)], ...], BeforeValidator(several), Field(min_length=1, max_length=20)]


class RetrieveConfig(FilesConfig, RunsConfig, MachineConfig, ClusterConfig, StepsConfig, SkipConfig):
    """Finding shapes by shapes, and how good that is."""

    run: str | None = option(None, "Run folder or its name; auto: the latest run", "Run", argument=True, names="runs")
    checkpoint: Literal["best", "last"] = option("best", "Weights to use", "Run")
    query: tuple[str, ...] = option(
        (),
        "Instead of measuring, find the training shapes most like this file; - reads names from standard input",
        "Data",
        metavar="FILE",
        many=True,
    )
    top: int = option(10, "Hits of each query file", "Answer", ge=1, le=1000)
    protocol: Literal["paper", "shrec17"] = option(
        "paper",
        "paper: test shapes search all training shapes; shrec17: a split searches itself, by that contest's rules",
        "Measure",
    )
    split: Literal["test", "val", "train"] = option("test", "Split that is searched by shrec17", "Measure")
    lists: Literal["nearest", "same-class"] = option(
        "nearest", "What shrec17 answers: the 1000 nearest, or those among them of the predicted class", "Measure"
    )
    metric: Literal["euclidean", "cosine"] = option("euclidean", "How descriptors are compared", "Measure")
    no_lfda: bool = option(False, "Compare descriptors as they are, without LFDA", "Measure")
    lfda_dim: int = option(128, "Dimensions that LFDA keeps, at most", "Measure", ge=1, le=100_000)
    index: Literal["exact", "faiss"] = option(
        "exact", "How hits are found; faiss: approximately, with its recall (needs the extra of that name)", "Measure"
    )
    at: Cuts = option(
        "1,10,100",
        "List lengths N for P@N, R@N and F1@N of paper",
        "Measure",
        metavar="LIST",
        validate_default=True,
    )
    limit: int | None = option(None, "Use only this many queries, of each class in turn", "Data", ge=1)
    gallery_limit: int | None = option(
        None, "Search only this many training shapes, of each class in turn", "Data", ge=2
    )
    seed: int = option(0, "Of limited shapes, pictured queries and random views", "Data", ge=0, le=2**32 - 1)
    figure: int = option(5, "Queries in the figure; 0: none", "Answer", ge=0, le=50)
    out: Path | None = option(
        None,
        "Folder for tables and pictures, with shrec17 also its result files; auto: in the run, no result files",
        "Answer",
        metavar="DIR",
        short="-o",
    )

    @model_validator(mode="after")
    def _check_combinations(self) -> RetrieveConfig:
        if self.query and self.protocol == "shrec17":
            raise UsageError(
                "--query finds shapes for a file, --protocol shrec17 measures a whole split",
                hint="leave one of them out",
                code="retrieve.query",
            )
        return self
