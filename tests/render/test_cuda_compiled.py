"""Every CUDA kernel is really compiled to PTX, which needs no GPU: what the simulator does not look at is its types."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from reference import scenes
from reference.drawing import cameras, matrices

if find_spec("numba_cuda") is None:
    pytest.skip("numba-cuda is not installed", allow_module_level=True)

from numba import cuda, types
from numba.cuda import dispatcher
from numba.cuda.cudadrv import nvvm
from numba.np.numpy_support import from_dtype

from mvtn_cli.core.render.gpu import compiled, mesh, painting, points, seeing

AMPERE = (8, 0)
KERNELS = [
    f"{room.__name__.rsplit('.', 1)[1]}.{name}"
    for room in (seeing, painting, points)
    for name, function in vars(room).items()
    if isinstance(function, dispatcher.CUDADispatcher) and not function.targetoptions.get("device")
    if function.py_func.__module__ == room.__name__
]


def named(function) -> str:
    return f"{function.py_func.__module__.rsplit('.', 1)[1]}.{function.py_func.__name__}"


def numba_type(value):
    if not isinstance(value, torch.Tensor):
        return types.boolean if isinstance(value, bool) else types.int64 if isinstance(value, int) else types.float64
    assert value.is_contiguous()
    return types.Array(from_dtype(value.detach().numpy().dtype), value.ndim, "C")


@pytest.fixture(scope="module")
def signatures():
    """Return the types that each kernel is launched with, by name; nothing is launched, and nothing is drawn."""
    found = {}

    def note(function, views, tasks, *arguments):
        found.setdefault(named(function), set()).add(tuple(map(numba_type, arguments)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh, "launch", note)
        patch.setattr(points, "launch", note)
        rts, cpu = torch.from_numpy(matrices(cameras((1.0, 2.0, 2.2)))), torch.device("cpu")
        for shape in (scenes.chair(), scenes.soup(3, 1, colored=True)):
            look = scenes.look(8, light_direction=np.float32([[0.48, 0.6, 0.64]]))
            scene = mesh.GpuMeshScene(scenes.batch_of(shape), look, scenes.FOV, cpu)
            images, ids = scene.draw(rts, keep=True)
            scene.gradient(rts, ids, images)
        look = replace(look, kind="points")
        cloud = points.GpuPointScene(
            torch.zeros(1, 5, 3), np.ones((1, 5, 3), np.float32), np.ones((1, 5)), 8.0, look, cpu
        )
        cloud.gradient(rts, cloud.draw(rts))
    return found


@pytest.fixture
def without_a_device(monkeypatch):
    """numba-cuda asks a device for what it compiles inner functions for."""
    if not nvvm.is_available():
        pytest.skip("NVVM is not installed")
    monkeypatch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=AMPERE))


def to_ptx(function, signature) -> str:
    return cuda.compile(function, signature, device=False, cc=AMPERE, abi="numba", output="ptx")[0]


def contractions(ptx: str) -> int:
    """How many products and sums may be, or are, rounded but once."""
    return len(re.findall(r"\b(?:fma\.rn|mul|add|sub)\.f64", ptx))


@pytest.mark.parametrize("name", KERNELS)
def test_each_kernel_compiles_for_the_one_set_of_types_that_it_is_launched_with(name, signatures, without_a_device):
    (signature,) = signatures[name]
    room, kernel = name.split(".")
    function = getattr({"seeing": seeing, "painting": painting, "points": points}[room], kernel).py_func
    with compiled.uncontracted():
        ptx = to_ptx(function, signature)
    assert ".visible .entry" in ptx
    if room == "seeing":  # powers of the shading are of a library that does contract
        assert contractions(ptx) == 0 and "mul.rn.f64" in ptx


def test_numba_would_contract_if_it_were_let(signatures, without_a_device):
    (signature,) = signatures["seeing.project_views"]

    def project_again(vertices, offsets, rts, shape_of, starts, focal, side, camera, screen):
        camera[0, 0] = rts[0, 0, 0] * camera[1, 0] + rts[0, 0, 1]

    assert contractions(to_ptx(project_again, signature)) > 0
    with compiled.uncontracted():
        assert contractions(to_ptx(project_again, signature)) == 0
