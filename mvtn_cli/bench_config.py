"""Settings of `mvtn bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field, model_validator

from mvtn_cli.errors import UsageError
from mvtn_cli.fields import Config, option, several

What = Literal["gradient", "render", "pose", "image", "stiff", "skips", "retrieval", "complexity", "growth"]
WHATS: tuple[str, ...] = get_args(What)
Names = Annotated[tuple[str, ...], BeforeValidator(several)]


def _split(value: Any) -> Any:
    """Read lists within a list: an option may be repeated, and each time have several names."""
    words = several(value)
    return [part for word in words for part in several(word)] if isinstance(words, list | tuple) else words


NameLists = Annotated[tuple[str, ...], BeforeValidator(_split)]
Sizes = Annotated[tuple[Annotated[int, Field(ge=25, le=1_000_000)], ...], BeforeValidator(several)]


class BenchConfig(Config):
    """Error against run time of the renderer."""

    what: What = option(
        "gradient",
        "gradient: how right it is; render: what it costs beside ResNet-18; pose: whether it finds cameras again; "
        "image: how right pictures are; stiff: what breaks renderers; "
        "skips: what is left out, and what that saves; retrieval: time and memory of exact measures; "
        "complexity: operations, weights, time and memory of whole networks; "
        "growth: time and memory of whole commands on more and more shapes",
        "Data",
        argument=True,
    )
    files: tuple[str, ...] = option((), "More meshes, as after --mesh", "Data", argument="many")
    mesh: Names = option((), "Meshes instead of the built-in ones", "Data", metavar="FILE...", many=True)
    up: Literal["y", "z"] | None = option(None, "Axis that points up in the files; auto: y", "Data")
    compare: str | None = option(
        None, "Measure nothing; compare two answers of bench --json", "Compare", metavar="A.json B.json"
    )
    quick: bool = option(False, "At most two minutes: less of everything, which is said", "Measure")
    image_size: int | None = option(None, "Width and height of a view, pixels; auto: 224", "Measure", ge=8, le=1024)
    num_views: int | None = option(None, "Views of each mesh; auto: 12", "Measure", ge=1, le=100)
    look: Literal["studio", "relief", "paper"] = option(
        "studio", "Material: studio: soft; relief: steep; paper: as published; black behind all", "Measure"
    )
    queries: int | None = option(None, "Shapes that search, for retrieval; auto: 10265", "Measure", ge=1)
    gallery: int | None = option(None, "Shapes that are searched, for retrieval; auto: 35764", "Measure", ge=1)
    dim: int | None = option(None, "Numbers in a descriptor, for retrieval; auto: 128", "Measure", ge=1, le=100_000)
    networks: NameLists = option(
        (), "Presets to measure, for complexity; auto: MVCNN and View-GCN with learned views", "Measure",
        metavar="LIST", many=True,
    )  # fmt: skip
    sizes: Sizes = option((), "Shapes, for growth; auto: 100,1000,10000", "Measure", metavar="LIST")
    work: Path | None = option(
        None, "Folder of growth, where the same command goes on; auto: ./growth", "Measure", metavar="DIR"
    )
    seed: int = option(0, "Of loss weights, lights, colours and starts", "Measure", ge=0, le=2**32 - 1)
    csv: Path | None = option(None, "Also write the rows as CSV", "Answer", metavar="FILE")
    plot: Path | None = option(None, "Also plot error against time, .svg or .png", "Answer", metavar="FILE")
    threads: int | None = option(
        None,
        "CPU threads; auto: all cores; render measures at 1 and at these, auto: 2; growth with these, auto: 1",
        "Machine",
        ge=1,
        le=1024,
    )

    @model_validator(mode="before")
    @classmethod
    def _words_of_comparison(cls, values: Any) -> Any:
        """In `--compare A.json B.json` the second name arrives where a benchmark's name is expected."""
        if not isinstance(values, dict) or values.get("compare") in (None, "auto"):
            return values
        values, what = dict(values), values.get("what")
        if what is not None and what not in WHATS:
            del values["what"]
            values["files"] = (what, *values.get("files", ()))
        return values

    @model_validator(mode="after")
    def _check_combinations(self) -> BenchConfig:
        if self.compare is not None and (len(self.files) != 1 or self.mesh):
            raise UsageError(
                "--compare takes two answers of mvtn bench --json",
                hint="mvtn bench --compare A.json B.json",
                code="bench.compare",
            )
        if self.what == "stiff" and self.compare is None and self.meshes:
            raise UsageError("the stiff set brings its own meshes", hint="leave --mesh out", code="bench.mesh")
        if self.what == "retrieval" and self.compare is None and self.meshes:
            raise UsageError("retrieval is measured with random numbers", hint="leave --mesh out", code="bench.mesh")
        if self.what == "growth" and self.compare is None and self.meshes:
            raise UsageError("growth is measured on built-in shapes", hint="leave --mesh out", code="bench.mesh")
        wrong = "sizes" if self.sizes else "work" if self.work else None
        if wrong and self.what != "growth":
            raise UsageError(f"--{wrong} belongs to mvtn bench growth", hint=f"leave --{wrong} out", code="bench.sizes")
        sizes = [name for name in ("queries", "gallery", "dim") if getattr(self, name) is not None]
        if sizes and self.what != "retrieval":
            raise UsageError(
                f"--{sizes[0]} belongs to mvtn bench retrieval", hint=f"leave --{sizes[0]} out", code="bench.sizes"
            )
        if self.networks and self.what != "complexity":
            raise UsageError(
                "--networks belongs to mvtn bench complexity", hint="leave --networks out", code="bench.networks"
            )
        return self

    @property
    def meshes(self) -> tuple[str, ...]:
        """All files that were named."""
        return (*self.mesh, *self.files)
