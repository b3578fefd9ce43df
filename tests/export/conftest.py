"""Small recognisers for export."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from threads import one_thread  # noqa: F401
from torch import nn

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.recogniser import Recogniser, build_recogniser


@pytest.fixture
def exporting() -> None:
    """What only the extra can do."""
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package, reason=f"the extra export is not installed: no {package}")


@pytest.fixture
def recogniser() -> Callable[..., Recogniser]:
    """Build a recogniser on three classes whose every weight and statistic is drawn, as if it had learned."""

    def build(**changed: Any) -> Recogniser:
        tiny = {"image_size": 16, "views": "fixed", "num_views": 4, "encoder_points": 24, "epochs": 2, **changed}
        model = build_recogniser(TrainConfig(**tiny), 3)
        with torch.random.fork_rng(devices=[]), torch.no_grad():
            torch.manual_seed(3)
            for weight in model.parameters():
                weight.add_(0.02 * torch.randn_like(weight))
            for module in model.modules():
                if isinstance(module, nn.BatchNorm1d | nn.BatchNorm2d):
                    module.running_mean.normal_(0, 0.1)
                    module.running_var.uniform_(0.5, 2)
        return model.eval()

    return build


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder, without the caller's settings."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for name in [name for name in os.environ if name.startswith("MVTN_") and name != "MVTN_CACHE"]:
        monkeypatch.delenv(name)
    return folder
