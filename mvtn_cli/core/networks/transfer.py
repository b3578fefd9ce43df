"""Views from the viewpoint network of another run, which learns no more."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from mvtn_cli.core.networks.run_files import RunFiles, read_run
from mvtn_cli.core.networks.settings import SelectorSettings
from mvtn_cli.core.networks.viewpoint import Angles, Choice, ViewSelector
from mvtn_cli.core.networks.weights import load_strictly
from mvtn_cli.errors import UsageError

Build = Callable[[SelectorSettings], ViewSelector]


class TransferredViews(ViewSelector):
    """The views that a trained viewpoint network says, in training as in evaluation, without noise.

    Its weights and what it is made of are part of the state dict, so that a run which uses it needs the other
    one no more. It is empty until `take` or `load_state_dict` fills it.

    Args:
        start: The layout (M,) of this run; its length is what the network must have.
        distance, fov_deg: As in the base; a learned distance comes from the network.
        build: Makes a selector from its settings.
    """

    source: Tensor

    def __init__(self, start: Angles, distance: float, fov_deg: float, *, build: Build) -> None:
        super().__init__(start, distance, fov_deg)
        self.build = build
        self.inner: ViewSelector | None = None
        self.register_buffer("source", torch.zeros(0, dtype=torch.uint8))

    def take(self, folder: Path) -> None:
        """Fill it from the folder of a run.

        Raises:
            UsageError: That run's views are not learned, or of another number.
            DataError: The run can't be read.
        """
        run = read_run(folder)
        settings, prefix = _selector_of(run)
        if settings.num_views != self.num_views:
            raise UsageError(
                f"run {run.folder.name} chooses {settings.num_views} views, not {self.num_views}",
                hint=f"add --num-views {settings.num_views}",
                code="views.transferred",
            )
        self._become(_as_bytes(settings))
        assert self.inner is not None
        load_strictly(self.inner, run.part(prefix), network="the viewpoint network", source=str(run.folder))

    def choose(self, points: Tensor, training: bool, generator: torch.Generator | None) -> Choice:
        assert self.inner is not None, "no viewpoint network was taken"
        choice = self.inner.choose(points, False, generator)
        self._squashed = self.inner._squashed
        return choice

    def train(self, mode: bool = True) -> TransferredViews:
        super().train(mode)
        if self.inner is not None:
            self.inner.eval()
        return self

    def _become(self, source: Tensor) -> None:
        settings = SelectorSettings.from_mapping(json.loads(bytes(source.tolist())))
        device = self.start_azimuth.device
        with torch.random.fork_rng(devices=[]):  # the numbers drawn here are overwritten
            self.inner = self.build(settings).to(device).requires_grad_(False).eval()
        self.source, self.encoder_points = source.to(device), settings.encoder_points

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *arguments: Any) -> None:
        if (source := state_dict.get(f"{prefix}source")) is not None and len(source):
            self._become(source)
        super()._load_from_state_dict(state_dict, prefix, *arguments)


def _selector_of(run: RunFiles) -> tuple[SelectorSettings, str]:
    """What its viewpoint network is made of, and where in the weights it is.

    Raises:
        UsageError: It has none.
    """
    settings = SelectorSettings.from_mapping(run.settings)
    if settings.views == "transferred":  # of a third run: taken from there as it is
        kept = json.loads(bytes(run.weights["selector.source"].tolist()))
        return SelectorSettings.from_mapping(kept), "selector.inner."
    if not settings.views.startswith("learned"):
        raise UsageError(
            f"run {run.folder.name} has no viewpoint network: its views are {settings.views}",
            hint="take the views from a run with --views learned-…",
            code="views.transferred",
        )
    return settings, "selector."


def _as_bytes(settings: SelectorSettings) -> Tensor:
    return torch.tensor(list(json.dumps(asdict(settings)).encode()), dtype=torch.uint8)
