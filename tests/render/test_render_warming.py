"""Compiling ahead, and saying so."""

from __future__ import annotations

import io

import pytest

from mvtn_cli.console import Console
from mvtn_cli.core.render import render, warming
from mvtn_cli.core.render.warming import compile_renderer


@pytest.mark.parametrize(("kind", "gradient"), [("mesh", True), ("mesh", False), ("points", True)])
def test_an_empty_folder_of_kernels_is_announced_and_each_job_runs(kind, gradient, monkeypatch, tmp_path):
    monkeypatch.setattr(warming, "kernel_folder", lambda: tmp_path)
    err = io.StringIO()
    compile_renderer(Console(err=err), kind=kind, gradient=gradient)
    assert err.getvalue().startswith("compiling the renderer for this machine")


@pytest.mark.parametrize("gradient", [True, False])
def test_a_gpu_that_draws_is_warmed_by_drawing_on_it_alone(gradient, monkeypatch, tmp_path):
    asked: list[bool] = []

    def draw(batch, cameras, look):
        asked.append(cameras.azimuth_deg.requires_grad)
        return render(batch, cameras, look)

    monkeypatch.setattr(warming, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr(warming, "is_gpu", lambda device: True)
    monkeypatch.setattr(warming, "render", draw)
    monkeypatch.setattr(warming, "MeshScene", lambda *_: pytest.fail("drawn on the CPU"))
    compile_renderer(Console(err=io.StringIO()), gradient=gradient)
    assert asked == [False, True][: 1 + gradient]


def test_nothing_is_said_or_drawn_where_kernels_are_kept(monkeypatch, tmp_path):
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper" / "see.nbi").touch()
    monkeypatch.setattr(warming, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr(warming, "render", lambda *_: pytest.fail("drawn"))
    err = io.StringIO()
    compile_renderer(Console(err=err))
    assert err.getvalue() == ""
