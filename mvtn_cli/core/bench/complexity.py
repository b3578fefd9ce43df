"""`mvtn bench complexity`: operations, weights, seconds and memory of whole networks, stage by stage."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.bench.outcome import Outcome, Row
from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.bench.subjects import Subject
from mvtn_cli.core.bench.timing import Timing, interleaved, timed
from mvtn_cli.core.networks import Output, Recogniser, build_recogniser
from mvtn_cli.core.networks.viewpoint import Placement
from mvtn_cli.core.render import Look, pack
from mvtn_cli.core.views import Cameras, camera_positions
from mvtn_cli.presets import find_preset

CLASSES = 40
STEP_SHAPES = 2  # of which BatchNorm needs at least two
FORWARD = ("point encoder", "viewpoint network", "pictures", "classifier")
STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Published:
    """What the paper's table of time and memory has for a stage: giga-operations, weights, milliseconds."""

    gflops: float | None = None
    parameters: float | None = None
    ms: float | None = None
    source: str = ""


PAPER = {  # by stage, and by network where it matters; all of 12 views of 224 pixels and 40 classes
    "point encoder": Published(
        1.8,
        3.5e6,
        4.24,
        "weights, time: the paper's text (its supplement swaps them); operations: as later papers quote",
    ),
    "viewpoint network": Published(parameters=9.09e3, source="the paper's supplement"),
    "classifier mvcnn": Published(43.7, 11.20e6, source="weights: the paper; operations: as later papers quote it"),
    "classifier viewgcn": Published(parameters=23.56e6, source="the paper"),
}


@dataclass(frozen=True)
class Chain:
    """One network, and shapes that it is run on.

    Attributes:
        name: Of the preset.
        config: Its settings, at the sizes of the benchmark.
        subjects: B shapes.
        seed: Of lights, colours and labels.
    """

    name: str
    config: TrainConfig
    subjects: tuple[Subject, ...]
    seed: int

    @cached_property
    def model(self) -> Recogniser:
        """With random weights: they change no count."""
        return build_recogniser(self.config, CLASSES, read_weights=False)

    @cached_property
    def batch(self) -> Any:
        """The B shapes, packed."""
        return pack([subject.shape for subject in self.subjects], labels=self._labels)

    @property
    def _labels(self) -> list[int]:
        return [number % CLASSES for number in range(len(self.subjects))]

    @cached_property
    def look(self) -> Look:
        """As in training."""
        kind = "points" if self.config.render == "points" else "mesh"
        return Look.training(self.config, len(self.subjects), kind, torch.Generator().manual_seed(self.seed))

    @cached_property
    def points(self) -> Tensor:
        """(B, P, 3), what an encoder sees."""
        return self.batch.points[:, : self.config.encoder_points]

    @cached_property
    def encoder(self) -> nn.Module | None:
        """Of the viewpoint network; None where views are not learned."""
        return getattr(self.model.selector, "encoder", None)

    @cached_property
    def placement(self) -> Placement:
        """Where the untrained viewpoint network puts the cameras."""
        with evaluating(self.model):
            return self.model.place(self.batch)

    @cached_property
    def images(self) -> Tensor | None:
        """(B, M, 3, H, W); None for a network that looks at points."""
        if not self.model.uses_views:
            return None
        with evaluating(self.model):
            return self.model.take_pictures(self.batch, self.look, self.placement)

    def classify(self) -> Any:
        """The classifier alone."""
        if self.images is None:
            return self.model.network(self.points)
        cameras: Cameras = self.placement.cameras
        directions = camera_positions(cameras.azimuth_deg, cameras.elevation_deg, 1.0).to(self.images)
        points = self.points if getattr(self.model.network, "points", None) is not None else None
        return self.model.network(self.images, directions, points)

    def forward(self) -> Output:
        """All stages, as in training."""
        return self.model(self.batch, self.look, generator=torch.Generator().manual_seed(self.seed))

    def loss(self) -> Tensor:
        """Of a forward pass; `backward` of it is the other half of a step."""
        return self.model.loss(self.forward(), self.batch.labels)


def measure_complexity(subjects: Sequence[Subject], plan: Plan, console: Console) -> Outcome:
    """Count and time the networks of some presets, at the plan's views and pixels.

    Operations are those of matrix products and convolutions in one forward pass of one shape, a multiplication and
    an addition counting as two. Seconds are medians, of one shape of a batch of two, on the CPU. Memory is the most
    that the whole process held in a step of training; None where the system does not tell.

    Args:
        subjects: At least one; taken in turn.
        plan: `networks` names the presets.
        console: For progress.

    Raises:
        UsageError: There is no such preset, or it does not go with the number of views.
    """
    chains = [_chain(name, subjects, plan) for name in plan.networks]
    rows: list[Row] = []
    with console.progress("networks", len(chains)) as ticker:
        for chain in chains:
            rows += _rows(chain, plan.repeats)
            ticker.advance()
    return Outcome(rows, _summary(rows), notes={"paper": {stage: vars(known) for stage, known in PAPER.items()}})


def _chain(name: str, subjects: Sequence[Subject], plan: Plan) -> Chain:
    values = {**find_preset(name).values, "image_size": plan.image_size, "num_views": plan.num_views}
    config = TrainConfig.model_validate(values)
    return Chain(name, config, tuple(itertools.islice(itertools.cycle(subjects), STEP_SHAPES)), plan.seed)


def _rows(chain: Chain, repeats: int) -> list[Row]:
    """A row a stage, then the backward pass and the whole step."""
    works = _stages(chain)
    shapes = len(chain.subjects)
    with evaluating(chain.model):
        counts = {stage: flops_of(work) / shapes for stage, work in works.items()}
        timings = interleaved(works, repeats)
    forward, backward, peak = _step(chain, repeats)
    weights = _weights(chain)
    rows = [
        _row(chain, stage, timings[stage].median / shapes, flops=counts[stage], parameters=weights[stage])
        for stage in works
    ]
    rows.append(_row(chain, "backward", backward.median / shapes))
    total = (forward.median + backward.median) / shapes
    rows.append(_row(chain, "step", total, flops=sum(counts.values()), parameters=sum(weights.values()), peak=peak))
    return rows


def _stages(chain: Chain) -> dict[str, Callable[[], object]]:
    """The stages that this network has, each with its input at hand."""
    works: dict[str, Callable[[], object]] = {}
    inputs = chain.placement, chain.images  # made before anything is counted
    assert (inputs[1] is not None) == chain.model.uses_views
    if (encoder := chain.encoder) is not None:
        works["point encoder"] = lambda: encoder(chain.points)
        works["viewpoint network"] = _without_encoder(chain)
    if chain.model.uses_views:
        works["pictures"] = lambda: chain.model.take_pictures(chain.batch, chain.look, chain.placement)
    return {**works, "classifier": chain.classify}


def _without_encoder(chain: Chain) -> Callable[[], object]:
    """The viewpoint network from the features of the points on."""
    assert chain.encoder is not None
    selector = copy.deepcopy(chain.model.selector)
    with evaluating(chain.model):
        selector.encoder = Known(chain.encoder(chain.points))
    return lambda: selector.place(chain.points, training=False)


def _step(chain: Chain, repeats: int) -> tuple[Timing, Timing, float | None]:
    """Seconds forward and backward of a step of training, and its peak memory in MiB."""
    forward, backward = Timing(), Timing()
    chain.model.train()
    peak = peak_mib(lambda: chain.loss().backward())
    for number in range(repeats + 1):
        chain.model.zero_grad(set_to_none=True)
        losses: list[Tensor] = []
        ahead = timed(lambda found=losses: found.append(chain.loss()))  # type: ignore[misc]
        back = timed(losses[0].backward)
        if number:
            forward.seconds.append(ahead)
            backward.seconds.append(back)
        else:
            forward.first, backward.first = ahead, back
    chain.model.zero_grad(set_to_none=True)
    return forward, backward, peak


def _weights(chain: Chain) -> dict[str, int]:
    encoder = _count(chain.encoder) if chain.encoder is not None else 0
    return {
        "point encoder": encoder,
        "viewpoint network": _count(chain.model.selector) - encoder,
        "pictures": 0,
        "classifier": _count(chain.model.network),
    }


def _count(module: nn.Module) -> int:
    return sum(weight.numel() for weight in module.parameters())


def _row(
    chain: Chain,
    stage: str,
    seconds: float,
    *,
    flops: float | None = None,
    parameters: int | None = None,
    peak: float | None = None,
) -> Row:
    config = chain.config
    known = PAPER.get(stage) or PAPER.get(f"{stage} {config.network}") or Published()
    return {
        "network": chain.name,
        "stage": stage,
        "views": config.num_views,
        "image_size": config.image_size,
        "gflops": None if flops is None else flops / 1e9,
        "paper_gflops": known.gflops,
        "parameters": parameters,
        "paper_parameters": known.parameters,
        "seconds": seconds,
        "paper_ms": known.ms,
        "peak_mib": peak,
    }


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Of the first network: the whole, and how much of its time goes into choosing and taking the pictures."""
    own = {row["stage"]: row for row in rows if row["network"] == rows[0]["network"]}
    forward = sum(own[stage]["seconds"] for stage in FORWARD if stage in own)
    chosen = sum(own[stage]["seconds"] for stage in FORWARD[:2] if stage in own)
    drawn = own["pictures"]["seconds"] if "pictures" in own else 0.0
    return {
        "network": rows[0]["network"],
        "gflops": own["step"]["gflops"],
        "parameters": own["step"]["parameters"],
        "seconds": own["step"]["seconds"],
        "choosing_share": chosen / forward,
        "drawing_share": drawn / forward,
    }


# Tools


class Known(nn.Module):
    """Gives what it holds, whatever comes in."""

    def __init__(self, features: Tensor) -> None:
        super().__init__()
        self.features = features

    def forward(self, points: Tensor) -> Tensor:
        return self.features


def flops_of(work: Callable[[], object]) -> float:
    """Operations of the matrix products and convolutions in a call; a multiplication and an addition are two."""
    counter = FlopCounterMode(display=False)
    with counter:
        work()
    return float(counter.get_total_flops())


@contextmanager
def evaluating(model: nn.Module) -> Iterator[None]:
    """Without dropout or gradient."""
    was_training = model.training
    model.eval()
    try:
        with torch.no_grad():
            yield
    finally:
        model.train(was_training)


def peak_mib(work: Callable[[], object]) -> float | None:
    """The most memory that this process holds during a call, MiB; None where the system does not tell."""
    try:
        CLEAR.write_text("5", encoding="ascii")  # Linux: forget the highest size so far
    except OSError:
        work()
        return None
    work()
    for line in STATUS.read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    return None
