"""What a step of training works on: made while the networks work on the step before."""

from __future__ import annotations

from typing import NamedTuple

import torch

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.recogniser import Recogniser, Seen
from mvtn_cli.core.render import Look, ShapeBatch
from mvtn_cli.core.render.devices import drawing_device, is_gpu
from mvtn_cli.core.training.draws import look_of
from mvtn_cli.core.training.fixed_views import load_batch
from mvtn_cli.core.training.randomness import step_generator
from mvtn_cli.core.training.shapes import Shapes
from mvtn_cli.core.training.team import Team


class Ready(NamedTuple):
    """A process's share of a batch.

    Attributes:
        batch: Its shapes.
        look: Of their pictures.
        generator: Of what is still to be drawn at random.
        seen: Their pictures, if those do not wait for the step before.
    """

    batch: ShapeBatch
    look: Look
    generator: torch.Generator
    seen: Seen | None


def spare_drawer(model: Recogniser) -> Recogniser | None:
    """Who can take pictures while the networks work on others: a double of the model on the CPU, or nobody.

    Cameras that learn wait for the step before. Networks on the CPU leave no core free that would draw meanwhile, and a
    GPU that draws for itself is as busy.
    """
    elsewhere = model.device.type != "cpu" and not is_gpu(drawing_device(model.device))
    return model.for_drawing() if elsewhere and model.uses_views and not model.selector.learned else None


class ReadyMaker:
    """Makes ready the steps of a training.

    Args:
        team: The processes.
        model: What is trained.
        shapes: The data set.
        config: Of the training.
    """

    def __init__(self, team: Team, model: Recogniser, shapes: Shapes, config: TrainConfig) -> None:
        self.team, self.shapes, self.config = team, shapes, config
        self.drawer = spare_drawer(model)
        self.pinned = is_gpu(drawing_device(model.device))

    def make(self, batch: list[int], epoch: int, step: int) -> Ready:
        """Load this process's share of a batch, and draw it if somebody can.

        Args:
            batch: Indices of the whole batch.
            epoch: From 0.
            step: Of the epoch, from 0; all that is random comes from the seed and these two.
        """
        config, share = self.config, self.team.share_of(batch)
        packed, kind = load_batch(self.shapes, batch[share.rows], config.render)
        generator = step_generator(config.seed, epoch, step)
        look = look_of(share, Look.training(config, share.total, kind, generator))
        if self.drawer is None:
            return Ready(packed.pinned() if self.pinned else packed, look, generator, None)
        with torch.no_grad(), self.team.drawing(share):
            placement = self.drawer.place(packed, generator=generator)
            images = self.drawer.take_pictures(packed, look, placement)
        return Ready(packed, look, generator, Seen(placement, images))
