"""Compiling ahead, and saying so."""

from __future__ import annotations

import io

import pytest

from mvtn_cli.console import Console
from mvtn_cli.core.render import warming
from mvtn_cli.core.render.warming import compile_renderer


@pytest.mark.parametrize(("kind", "gradient"), [("mesh", True), ("mesh", False), ("points", True)])
def test_an_empty_folder_of_kernels_is_announced_and_each_job_runs(kind, gradient, monkeypatch, tmp_path):
    monkeypatch.setattr(warming, "kernel_folder", lambda: tmp_path)
    err = io.StringIO()
    compile_renderer(Console(err=err), kind=kind, gradient=gradient)
    assert err.getvalue().startswith("compiling the renderer for this machine")


def test_nothing_is_said_or_drawn_where_kernels_are_kept(monkeypatch, tmp_path):
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper" / "see.nbi").touch()
    monkeypatch.setattr(warming, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr(warming, "render", lambda *_: pytest.fail("drawn"))
    err = io.StringIO()
    compile_renderer(Console(err=err))
    assert err.getvalue() == ""
