"""What a trained recogniser says about shapes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.networks.recogniser import Output, Recogniser, build_recogniser
from mvtn_cli.core.render import Look
from mvtn_cli.core.render.warming import compile_renderer
from mvtn_cli.core.training.checkpoint import read_weights
from mvtn_cli.core.training.device import choose_device
from mvtn_cli.core.training.fixed_views import load_batch
from mvtn_cli.core.training.randomness import evaluation_generator
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.training.shapes import Shapes, alike_batches, drawn_kind
from mvtn_cli.core.training.team import Team
from mvtn_cli.errors import DataError


@dataclass(frozen=True)
class Predictions:
    """Answers for N shapes, in the order they were asked for.

    Attributes:
        names: N names.
        labels: (N,) int64 true classes, -1 where unknown.
        logits: (N, C) float32.
        descriptors: (N, D) float32, what the last layer sees.
        azimuth_deg: (N, M) float32, not wrapped.
        elevation_deg: (N, M) float32, may lie beyond a pole.
        distance: (N, M) float32, shape radii from the centre.
        known_azimuth_deg: (N,) float64, NaN where no best view is known.
        images: (K, M, 3, H, W) uint8 of the first K shapes, or None; M is 0 for a network that looks at points.
        saturation: Share of the viewpoint network's outputs with |tanh| > 0.95; NaN without such a network.
    """

    names: tuple[str, ...]
    labels: NDArray[np.int64]
    logits: NDArray[np.float32]
    descriptors: NDArray[np.float32]
    azimuth_deg: NDArray[np.float32]
    elevation_deg: NDArray[np.float32]
    distance: NDArray[np.float32]
    known_azimuth_deg: NDArray[np.float64]
    images: NDArray[np.uint8] | None = None
    saturation: float = float("nan")

    @property
    def accuracy(self) -> float:
        """Share of shapes whose largest logit is the true class."""
        return float((self.logits.argmax(axis=1) == self.labels).mean())

    @property
    def loss(self) -> float:
        """Mean cross entropy."""
        loss = torch.nn.functional.cross_entropy(torch.from_numpy(self.logits), torch.from_numpy(self.labels))
        return float(loss)


def predict(
    model: Recogniser,
    prepared: Shapes,
    indices: Sequence[int],
    config: TrainConfig,
    *,
    batch_size: int,
    device: torch.device | str | None = None,
    console: Console | None = None,
    keep_images: int = 0,
    each_batch: Callable[[], None] | None = None,
    team: Team | None = None,
) -> Predictions:
    """Let a recogniser classify shapes: white, under a headlight, without noise, gradient or dropout.

    Args:
        model: Comes back in the mode, training or evaluation, that it was in.
        prepared: A Prepared, or anything with `records` and `load`.
        indices: Which of its records; at least one.
        config: The settings of the training; they say how pictures are taken.
        batch_size: Shapes at a time; no answer depends on it, unless views are random.
        device: Where to work; None is where the model is.
        console: Where progress is shown, if anywhere.
        keep_images: Keep the pictures of this many shapes, the first ones.
        each_batch: Called before each batch; may raise to end early.
        team: Processes that do it together: each takes every n-th batch, and all of them, which must all call
            this, get all answers.

    Raises:
        DataError: No shapes are given, or they can't be drawn.
    """
    if not len(indices):
        raise DataError("no shapes to classify", code="dataset.empty-split")
    if device is not None:
        model.to(device)
    quiet = console or Console(quiet=True)
    if model.uses_views:
        compile_renderer(quiet, model.device, kind=drawn_kind(prepared, indices[0], config.render))
    rank, size = (0, 1) if team is None else (team.rank, team.size)

    def answer() -> dict[int, dict[str, np.ndarray]]:
        """The answers of this process, by the number of their batch."""
        found, begun = {}, 0
        with _evaluating(model), torch.no_grad(), quiet.progress("classifying", len(indices)) as ticker:
            for number, chunk in enumerate(alike_batches(prepared, indices, batch_size, config.render)):
                wanted, begun = keep_images - begun, begun + len(chunk)
                if number % size != rank:
                    continue
                if each_batch is not None:
                    each_batch()
                batch, kind = load_batch(prepared, chunk, config.render)
                look = Look.evaluation(config, len(batch), kind)
                output = model(batch, look, generator=evaluation_generator(config.seed, number))
                found[number] = _arrays(output, max(0, wanted))
                found[number]["saturation"] = np.array([model.selector.saturation() * len(chunk)])
                ticker.advance(len(chunk))
        return found

    everybody = [answer()] if team is None else team.gather(team.together(answer))
    parts = [part for _, part in sorted((item for found in everybody for item in found.items()), key=itemgetter(0))]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    saturation, images = columns.pop("saturation"), columns.pop("images")
    records = [prepared.records[i] for i in indices]
    return Predictions(
        names=tuple(record.name for record in records),
        labels=np.array([record.label for record in records], np.int64),
        known_azimuth_deg=np.array([record.known_azimuth_deg for record in records], np.float64),
        **columns,
        images=images if keep_images > 0 else None,
        saturation=sum(saturation.tolist()) / len(records),
    )


def load_model(run: Run, checkpoint: str = "best", device: torch.device | str = "auto") -> Recogniser:
    """Build the recogniser of a run with its trained weights, in evaluation mode.

    Raises:
        DataError: The run has no such weights yet, or they do not fit.
    """
    path = run.require_weights(checkpoint)
    # what the backbone began with need not be there any more: the trained weights hold it
    model = build_recogniser(run.config, len(run.classes), read_weights=False)
    try:
        model.load_state_dict(read_weights(path))
    except RuntimeError as error:
        reason = " ".join(str(error).split()).partition("Recogniser: ")[2]
        raise DataError(
            f"the weights in {path} don't fit its config.toml: {reason}",
            hint="the run was made by another version of mvtn, or one of its files was changed: train it again",
            code="run.weights",
        ) from error
    model.to(choose_device(device) if isinstance(device, str) else device)
    return model.eval()


@contextmanager
def _evaluating(model: torch.nn.Module) -> Iterator[None]:
    was_training = model.training
    model.eval()
    try:
        yield
    finally:
        model.train(was_training)


def _arrays(output: Output, pictures: int) -> dict[str, np.ndarray]:
    """What is kept of an output: the pictures of its first shapes alone."""
    tensors = {
        "logits": output.logits,
        "descriptors": output.descriptor,
        "azimuth_deg": output.cameras.azimuth_deg,
        "elevation_deg": output.cameras.elevation_deg,
        "distance": output.cameras.distance.expand_as(output.cameras.azimuth_deg),
    }
    arrays = {name: tensor.float().cpu().numpy() for name, tensor in tensors.items()}
    return {**arrays, "images": _as_bytes(output.images[:pictures])}


def _as_bytes(images: Tensor) -> np.ndarray:
    """Pictures in [0, 1] as numbers 0..255, rounded."""
    return (images.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy()
