"""Fixtures of this room."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import torch
from tetrahedra import tetrahedron
from threads import one_thread  # noqa: F401

from mvtn_cli.core.networks import recogniser
from mvtn_cli.core.render import ShapeBatch, pack


@pytest.fixture
def batch() -> ShapeBatch:
    """Three shapes of three classes."""
    return pack([tetrahedron(s) for s in (1.0, 0.7, 0.4)], labels=[0, 1, 2], names=["a", "b", "c"])


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[SimpleNamespace]:
    """A stand-in for the renderer: pictures in colours of their cameras; keeps what it was asked."""
    kept: list[SimpleNamespace] = []

    def paint(batch, cameras, look, *, gradient, fd_step_deg):
        kept.append(SimpleNamespace(cameras=cameras, gradient=gradient, fd_step_deg=fd_step_deg, look=look))
        size = look.image_size
        ramp = torch.linspace(0, 1, size * size).reshape(size, size)
        stretch = 1 + batch.points.flatten(1).std(dim=1)[:, None, None, None, None]
        return SimpleNamespace(rgb=torch.sigmoid(stretch * cameras.positions[..., None, None] * ramp))

    monkeypatch.setattr(recogniser, "render", paint)
    return kept
