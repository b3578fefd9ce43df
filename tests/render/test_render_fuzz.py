"""Random scenes, the nastier the better: what is seen equals the twin's, and everything is finite."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference import scenes
from reference.drawing import cameras, gradients, matrices
from reference.rasteriser import rasterise

from mvtn_cli.core.render.mesh import MeshScene

SIZE = 11


def random_shape(random: np.random.Generator):
    """A soup whose vertices are partly shared, snapped to a coarse grid, repeated or far away."""
    count = int(random.integers(3, 12))
    vertices = random.uniform(-0.7, 0.7, (count, 3))
    if random.random() < 0.5:
        vertices = np.round(vertices * 4) / 4
    if random.random() < 0.2:
        vertices[random.integers(count)] *= 10.0 ** random.integers(1, 8)
    if random.random() < 0.1:
        vertices[random.integers(count)] = random.choice([np.nan, np.inf])
    return scenes.stored(vertices, random.integers(0, count, (int(random.integers(1, 16)), 3)))


def edge_on(twin, face: np.ndarray) -> bool:
    """Whether the eye lies in the plane of a face, to rounding: its depth at a sample is then anybody's guess."""
    corners = twin.camera[face]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    return bool(abs(normal @ corners[0]) <= 1e-9 * np.linalg.norm(normal) * np.linalg.norm(corners[0]))


def check(seed: int) -> None:
    random = np.random.default_rng(seed)
    shape = random_shape(random)
    view = (
        random.uniform(-400, 400),
        random.choice([-90.0, 0.0, 90.0, random.uniform(-100, 100)]),
        random.choice([0.2, 2.2]),
    )
    look = scenes.look(SIZE, shading=random.choice(["smooth", "flat"]), specular=random.choice([0.0, 0.2]))
    seen = MeshScene(scenes.batch_of(shape), look, scenes.FOV).see(matrices(cameras(view)))
    rt = matrices(cameras(view))[0, 0]
    twin = rasterise(shape.vertices, shape.faces, rt, scenes.focal(SIZE), SIZE)
    for j, i in np.argwhere(seen.ids[0] != twin.ids):
        faces = [face for face in (seen.ids[0, j, i], twin.ids[j, i]) if face >= 0]
        assert any(edge_on(twin, shape.faces[face]) for face in faces), seed
    weights = random.normal(size=(1, 3, SIZE, SIZE))
    for gradient in ("edge-flow", "fd"):
        assert np.isfinite(gradients(shape, cameras(view), replace(look), weights, gradient=gradient)).all(), seed


@pytest.mark.parametrize("block", range(4))
def test_random_scenes(block):
    for seed in range(50 * block, 50 * (block + 1)):
        check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(20))
def test_ten_thousand_random_scenes(block):
    for seed in range(500 * block, 500 * (block + 1)):
        check(1000 + seed)
