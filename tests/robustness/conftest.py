"""Shapes to corrupt: solids that are closed, with seams, colours and points on their surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from threads import one_thread  # noqa: F401

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.training.checkpoint import write_weights
from mvtn_cli.core.training.predict import predict
from mvtn_cli.core.training.run import Run


@pytest.fixture
def make_run(tmp_path) -> Callable[..., Run]:
    """Make a run that was never trained, but whose answers are even: it takes half of the test shapes for `odd`."""

    def make(prepared: Any, name: str = "a", **changed: Any) -> Run:
        settings = {"dataset": "toy", "num_views": 2, "image_size": 16, "views": "fixed", "encoder_points": 32}
        config = TrainConfig(**{**settings, **changed})
        run = Run.create(tmp_path / "runs" / name, config, prepared)
        model = build_recogniser(config, len(prepared.classes))
        random = np.random.default_rng(config.seed)
        with torch.no_grad():
            for weight in model.parameters():
                if weight.ndim == 2:
                    weight += torch.from_numpy(random.normal(0, 0.2, weight.shape)).float()
            logits = predict(model, prepared, prepared.split("test"), config, batch_size=8).logits
            last = [weight for weight in model.network.parameters() if weight.shape == (len(prepared.classes),)][-1]
            last[1] -= float(np.median(logits[:, 1] - logits[:, 0]))
        write_weights(run.weights_path("best"), model.state_dict(), {"epoch": 1})
        return run

    return make
