"""How much of everything a benchmark takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

FULL_SIZE, FULL_VIEWS = 224, 12  # what all published figures of this project are about


@dataclass(frozen=True)
class TruthSetting:
    """Central differences of a finely sampled image.

    Attributes:
        supersample: Samples a pixel in each direction, of one lattice.
        lattices: How many lattices, shifted against each other, are averaged.
        step_deg: Half the distance between the two images, degrees.
    """

    supersample: int
    lattices: int
    step_deg: float

    def __str__(self) -> str:
        return f"{self.supersample}x{self.supersample} samples on {self.lattices} lattices, {self.step_deg:g} deg"


@dataclass(frozen=True)
class Plan:
    """The sizes of one benchmark; the defaults are the full one.

    Attributes:
        image_size: Pixels along each side.
        num_views: Cameras of each mesh, on a golden spiral.
        look: The material, as in `mvtn train --look`; the background is black with all of them.
        seed: Of weights, lights, colours and starts.
        default_meshes: How many of the built-in meshes are taken where the user names none.
        smooth_truth: Truth for smooth weights, and a second setting that tells its uncertainty.
        sharp_truth: The same for white and network weights, which are constant within a pixel only: edges have to move
            by much less than one, and so the samples have to be finer.
        repeats: Timings of which the median counts, after one that does not.
        pose_steps: Adam steps of a pose recovery.
        image_truths: Samples a pixel of the true image, and of the second one that tells its uncertainty.
        batch_shapes: Shapes of the packed call that is held against single calls.
        stiff_size: Pixels along each side in the stiff set, the million faces apart.
        queries, gallery, dim: Of retrieval; those of ShapeNet Core55 after LFDA.
        networks: Presets, of complexity.
        sizes, work: Of growth: how many shapes, and the folder for them and for what is finished.
    """

    image_size: int = FULL_SIZE
    num_views: int = FULL_VIEWS
    look: str = "studio"
    seed: int = 0
    default_meshes: int = 3
    smooth_truth: tuple[TruthSetting, TruthSetting] = (TruthSetting(8, 4, 0.2), TruthSetting(7, 4, 0.15))
    sharp_truth: tuple[TruthSetting, TruthSetting] = (TruthSetting(8, 16, 0.05), TruthSetting(7, 16, 0.07))
    repeats: int = 7
    pose_steps: int = 80
    image_truths: tuple[int, int] = (16, 13)
    batch_shapes: int = 8
    stiff_size: int = FULL_SIZE
    queries: int = 10_265
    gallery: int = 35_764
    dim: int = 128
    networks: tuple[str, ...] = ("modelnet40-mvtn-mvcnn-12", "modelnet40-mvtn-viewgcn-12")
    sizes: tuple[int, ...] = (100, 1000, 10_000)
    work: Path = Path("growth")


WORDS = {  # what people call the sizes, and which benchmarks they belong to
    "image_size": ("pixels along each side", "gradient render pose image skips complexity"),
    "num_views": ("views", "gradient render pose image skips complexity"),
    "default_meshes": ("built-in meshes where none is named", "gradient render pose image skips"),
    "smooth_truth": ("truth for smooth weights", "gradient"),
    "sharp_truth": ("truth for white and cnn weights", "gradient"),
    "repeats": ("timings of which the median counts", "gradient render image skips complexity"),
    "pose_steps": ("steps", "pose"),
    "image_truths": ("samples a pixel of the true image", "image"),
    "batch_shapes": ("shapes in the packed call", "render"),
    "stiff_size": ("pixels along each side, the million faces apart", "stiff"),
    "queries": ("shapes that search", "retrieval"),
    "gallery": ("shapes that are searched", "retrieval"),
    "dim": ("numbers in a descriptor", "retrieval"),
    "networks": ("networks", "complexity"),
    "sizes": ("shapes", "growth"),
}
SMALL: dict[str, dict[str, Any]] = {"growth": {"image_size": 32, "num_views": 4}}  # full benchmarks of small pictures
QUICK: dict[str, dict[str, Any]] = {
    "gradient": {
        "num_views": 4,
        "default_meshes": 2,
        "repeats": 3,
        "smooth_truth": (TruthSetting(8, 2, 0.2), TruthSetting(7, 2, 0.25)),
        "sharp_truth": (TruthSetting(8, 4, 0.07), TruthSetting(7, 4, 0.1)),
    },
    "render": {"repeats": 3, "default_meshes": 1, "batch_shapes": 4},
    "pose": {"num_views": 6, "default_meshes": 2},
    "image": {"num_views": 4, "default_meshes": 2, "repeats": 3},
    "stiff": {"stiff_size": 64},
    "skips": {"num_views": 4, "default_meshes": 1, "repeats": 3},
    "retrieval": {"queries": 2000},
    "complexity": {"repeats": 3},
    "growth": {"sizes": (60, 120)},
}


def plan_for(
    what: str,
    *,
    quick: bool = False,
    image_size: int | None = None,
    num_views: int | None = None,
    look: str = "studio",
    seed: int = 0,
    **sizes: Any,
) -> Plan:
    """The plan of a benchmark: the full one, or a quick one, with the user's changes.

    `sizes` are further fields of the plan; None leaves one as it is.
    """
    plan = replace(Plan(look=look, seed=seed), **SMALL.get(what, {}), **(QUICK[what] if quick else {}))
    if image_size is not None:
        plan = replace(plan, image_size=image_size, stiff_size=image_size)
    if num_views is not None:
        plan = replace(plan, num_views=num_views)
    wanted: dict[str, Any] = {name: size for name, size in sizes.items() if size is not None}
    return replace(plan, **wanted)


def departures(what: str, plan: Plan) -> list[str]:
    """What of this benchmark is not as in the full one, in words."""
    full = Plan()
    return [
        f"{words}: {_words(getattr(plan, name))} (full: {_words(getattr(full, name))})"
        for name, (words, benchmarks) in WORDS.items()
        if what in benchmarks.split() and getattr(plan, name) != getattr(full, name)
    ]


def _words(value: Any) -> str:
    return ", then ".join(map(str, value)) if isinstance(value, tuple) else str(value)
