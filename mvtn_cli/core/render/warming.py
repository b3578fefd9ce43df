"""The first drawing on a machine compiles the renderer: done ahead and shown, instead of a first step that hangs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from mvtn_cli.console import Console
from mvtn_cli.core.render.batch import pack
from mvtn_cli.core.render.compiled import kernel_folder
from mvtn_cli.core.render.devices import drawing_device, is_gpu
from mvtn_cli.core.render.look import Look
from mvtn_cli.core.render.mesh import MeshScene, camera_matrices
from mvtn_cli.core.render.scene import render
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.views import Cameras

SIZE = 8
CPU = torch.device("cpu")


def compile_renderer(
    console: Console, device: torch.device = CPU, *, kind: str = "mesh", gradient: bool = False
) -> None:
    """Compile what drawing needs, where that has not been done on this machine, and show how far it is.

    Args:
        console: Where that is said.
        device: Of the cameras that will be drawn from.
        kind: "mesh" or "points".
        gradient: Whether cameras will be taught.
    """
    if any(kernel_folder().rglob("*.nbi")):
        return
    jobs = _jobs(kind, gradient, device)
    console.note("compiling the renderer for this machine: half a minute, once")
    with console.progress("compiling", len(jobs)) as ticker:
        for job in jobs:
            job()
            ticker.advance()


def _jobs(kind: str, gradient: bool, device: torch.device) -> list[Callable[[], object]]:
    """One drawing after another, each of which needs more kernels than those before it."""
    batch = pack([_tetrahedron()], labels=[0], names=["tetrahedron"])
    look = Look(SIZE, kind, np.ones((1, 3), np.float32), supersample=1)
    angle, still = torch.zeros((1, 1), device=device, requires_grad=True), torch.zeros((1, 1), device=device)
    cameras = Cameras(angle, still, still + 2.2)

    def teach() -> None:
        render(batch, cameras, look).rgb.sum().backward()

    if kind == "points" or is_gpu(drawing_device(device)):
        return [lambda: render(batch, cameras.detach(), look), *([teach] if gradient else [])]
    cameras = cameras.to(CPU)
    matrices = camera_matrices(cameras.azimuth_deg, cameras.elevation_deg, cameras.distance).detach().numpy()
    return [
        lambda: MeshScene(batch, look, cameras.fov_deg).see(matrices),
        lambda: MeshScene(batch, look, cameras.fov_deg).images(matrices),
        *([teach] if gradient else []),
    ]


def _tetrahedron() -> StoredShape:
    vertices = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32) / np.float32(3**0.5)
    return StoredShape(
        vertices=vertices,
        faces=np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32),
        normals=vertices,
        colors=None,
        points=vertices,
        point_colors=None,
        center=np.zeros(3),
        radius=1.0,
    )
