"""What colour a sample has: the shading against its twin, and against what must always hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import scenes
from reference.drawing import cameras, image, matrices, samples
from reference.rasteriser import rays
from reference.shading import draw

from mvtn_cli.core.render import MATERIALS, render

PAPER = dict(zip(("ambient", "diffuse", "specular", "shininess", "falloff"), MATERIALS["paper"], strict=True))
SIDE_LIGHT = np.array([[0.48, 0.6, 0.64]], np.float32)
STIFF = scenes.stiff()


def assert_like_the_twin(shape, view, look):
    found, rt = samples(shape, view, look), matrices(cameras(view))[0, 0]
    fine = look.image_size * look.supersample
    twin = draw(scenes.lit(shape, look), rt, scenes.focal(fine), fine)
    np.testing.assert_allclose(found.colors, twin, atol=1e-5)


@pytest.mark.parametrize("shading", ["smooth", "flat"])
@pytest.mark.parametrize("light", [None, SIDE_LIGHT], ids=["headlight", "side light"])
@pytest.mark.parametrize("material", [{}, PAPER], ids=["studio", "paper"])
@pytest.mark.parametrize("seed", range(2))
def test_colours_of_random_soups_equal_the_twin(seed, material, light, shading):
    look = scenes.look(
        10,
        colors=np.array([[0.9, 0.5, 0.2]], np.float32),
        background=(0.1, 0.2, 0.7),
        light_direction=light,
        shading=shading,
        supersample=1 + seed,
        **material,
    )
    shape = scenes.soup(25, seed, colored=seed == 1)
    assert_like_the_twin(shape, (71.0 * seed + 5, 20 - 50.0 * seed, 2.2), look)


@pytest.mark.parametrize("shading", ["smooth", "flat"])
@pytest.mark.parametrize("name", STIFF)
def test_colours_of_stiff_shapes_equal_the_twin(name, shading):
    """T5 to T8, T14, T15; needles a hundred times as long as wide have a normal all the same."""
    for view in ((33.0, 21.0, 1.0), (5.0, 0.0, 2.2), (200.0, -75.0, 0.3)):
        assert_like_the_twin(STIFF[name], view, scenes.look(15, shading=shading, light_direction=SIDE_LIGHT, **PAPER))


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    faces=st.integers(1, 12),
    edge=st.sampled_from([0.1, 0.8, 3.0]),
    azimuth=st.floats(-360, 360, width=32),
    elevation=st.floats(-180, 180, width=32),
    distance=st.floats(0.25, 4, width=32),
    smooth=st.booleans(),
    headlight=st.booleans(),
)
def test_any_soup_has_the_colours_of_the_twin(seed, faces, edge, azimuth, elevation, distance, smooth, headlight):
    light = np.random.default_rng(seed).standard_normal((1, 3))
    light = (light / np.linalg.norm(light)).astype(np.float32)
    look = scenes.look(8, shading="smooth" if smooth else "flat", light_direction=None if headlight else light, **PAPER)
    assert_like_the_twin(scenes.soup(faces, seed, edge=edge, colored=True), (azimuth, elevation, distance), look)


def test_a_red_mesh_is_red():
    """T8 too: colours belong to vertices, and are interpolated."""
    shape = scenes.bumpy(5)
    red = replace(shape, colors=np.tile(np.float32([1, 0, 0]), (len(shape.vertices), 1)))
    white, painted = (image(s, cameras((20, 10, 2.2)), scenes.look(24))[0] for s in (shape, red))
    np.testing.assert_allclose(painted[0], white[0], atol=1e-6)
    assert (painted[1:] == 0).all() and painted[0].max() > 0.8


def test_the_shapes_own_colour_multiplies():
    shape = scenes.soup(25, 1, colored=True)
    batch, views = scenes.batch_of(shape, shape), cameras((20, 10, 2.2), (100, -40, 2.2), count=2)
    colors = np.array([[1, 1, 1], [0.9, 0.25, 0.5]], np.float32)
    white, tinted = render(batch, views, scenes.look(24, 2, colors=colors), gradient="none").rgb
    expected = white * torch.tensor(colors[1])[None, :, None, None]
    torch.testing.assert_close(tinted, expected, atol=1e-6, rtol=0)


@pytest.mark.parametrize("shading", ["smooth", "flat"])
@pytest.mark.parametrize("light", [None, SIDE_LIGHT], ids=["headlight", "side light"])
def test_winding_makes_no_difference(light, shading):
    """Two-sided shading: all faces turned, some turned, and all vertex normals turned."""
    look, views = (
        scenes.look(24, shading=shading, light_direction=light),
        cameras((20, 10, 2.2), (120, -50, 2.2)),
    )
    for shape in (scenes.bumpy(5), scenes.chair(), scenes.soup(25, 2)):
        plain = image(shape, views, look)
        some = shape.faces.copy()
        some[::3] = some[::3, ::-1]
        for changed in (
            scenes.flipped(shape),
            replace(shape, faces=some),
            replace(shape, normals=-shape.normals),
        ):
            np.testing.assert_allclose(image(changed, views, look), plain, atol=1e-5)


def test_flat_icosahedron_has_one_colour_a_face_and_smooth_one_does_not():
    shape, view, light = scenes.icosahedron(), (13.0, 7.0, 2.2), SIDE_LIGHT
    lamp = {"light_direction": light, "ambient": 0.25, "diffuse": 0.75, "falloff": 1.0}
    flat = samples(shape, view, scenes.look(32, shading="flat", **lamp))
    smooth = samples(shape, view, scenes.look(32, shading="smooth", **lamp))
    for face in np.unique(flat.ids[flat.ids >= 0]):
        a, b, c = shape.vertices[shape.faces[face]].astype(np.float64)
        normal = (a + b + c) / np.linalg.norm(a + b + c)
        own = flat.colors[0][flat.ids == face]
        np.testing.assert_allclose(own, 0.25 + 0.75 * max(normal @ SIDE_LIGHT[0], 0), atol=1e-6)
        others = smooth.colors[0][smooth.ids == face]
        assert np.ptp(others) > 0.02 or others.max() <= 0.25 + 1e-6 or len(others) < 5
    assert len(np.unique(smooth.colors[0])) > 5 * len(np.unique(flat.colors[0]))


def test_interpolated_normals_of_an_icosahedron_point_from_its_middle_to_where_the_ray_hits():
    """Depth and normals, hand in hand: perspective-correct weights, world frame."""
    view, size = (40.0, -25.0, 2.2), 32
    drawn = render(
        scenes.batch_of(scenes.icosahedron()),
        cameras(view),
        scenes.look(size),
        gradient="none",
        outputs=("geometry",),
    )
    rt, depth, hit = matrices(cameras(view))[0, 0], drawn.depth[0, 0], drawn.face_ids[0, 0] >= 0
    at = rays(scenes.focal(size), size)[hit] * depth[hit, None] * [1, -1, -1]
    world = (at - rt[:, 3]) @ rt[:, :3]
    normals = drawn.normals[0, 0].transpose(1, 2, 0)
    np.testing.assert_allclose(normals[hit], world / np.linalg.norm(world, axis=1, keepdims=True), atol=1e-6)
    assert hit.any() and (normals[~hit] == 0).all()


def test_samples_that_see_nothing_have_the_background():
    background = (0.1, 0.2, 0.7)
    found = samples(scenes.chair(), (20.0, 30.0, 2.2), scenes.look(32, background=background))
    empty = found.ids < 0
    assert (found.colors[:, empty] == np.float32(background)[:, None]).all()
    near = np.zeros_like(empty)  # antialiasing reaches the next sample, no further
    for j, i in np.argwhere(~empty):
        near[max(j - 1, 0) : j + 2, max(i - 1, 0) : i + 2] = True
    assert (found.image[:, ~near] == np.float32(background)[:, None]).all() and (~near).any()
    inside = ~empty & ~near_to(empty)
    assert (np.abs(found.image[:, inside] - np.float32(background)[:, None]).max(axis=0) > 0.1).all()


def near_to(mask):
    """Return the mask grown by one sample in every direction."""
    grown = mask.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            grown |= np.roll(mask, step, axis)
    return grown


@pytest.mark.parametrize("fine", [1, 2])
def test_colours_stay_between_black_and_white(fine):
    """A speck has a jump on every side: antialiasing must not take its colour away twice."""
    for seed in range(6):
        for background in ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)):
            look = scenes.look(24, supersample=fine, background=background)
            drawn = image(scenes.soup(60, seed, edge=0.05), cameras((10.0 * seed, 20.0, 2.2)), look)
            assert drawn.min() >= -1e-6 and drawn.max() <= 1 + 1e-6
