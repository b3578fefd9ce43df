"""The call as a whole: cameras, batches, threads, gradient modes, and what is refused."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np
import pytest
import torch
from reference import scenes
from reference.drawing import cameras, gradients, image

from mvtn_cli.core.render import GRADIENTS, Look, check_look, pack, render
from mvtn_cli.core.render.devices import say_where
from mvtn_cli.errors import DataError, UsageError

SIDE_LIGHT = np.float32([0.48, 0.6, 0.64])
SHAPES = [scenes.bumpy(5), scenes.chair(), scenes.soup(25, 1, colored=True), scenes.icosahedron()]
VIEWS = [(20.0, 10.0, 2.2), (-130.0, -40.0, 1.7), (75.0, 95.0, 3.0)]


def with_points(shape, seed=0, count=50):
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3))
    return replace(shape, points=points.astype(np.float32))


def bytes_of(shapes, lights, *, kind="mesh", views=VIEWS, mode="edge-flow"):
    """Return the images and gradients of every (shape, view), each as bytes."""
    leaves = cameras(*views, count=len(shapes), grad=True)
    colors = np.tile(np.float32([1, 0.8, 0.6]), (len(shapes), 1))
    look = scenes.look(
        20, colors=colors, light_direction=lights, kind=kind, supersample=2, point_radius=0.05, specular=0.1
    )
    rgb = render(pack(shapes), leaves, look, gradient=mode).rgb
    (rgb * torch.linspace(-1, 1, 3 * 20 * 20).reshape(3, 20, 20)).sum().backward()
    slopes = torch.stack([leaves.azimuth_deg.grad, leaves.elevation_deg.grad, leaves.distance.grad], -1)
    return [
        [rgb[b, m].detach().numpy().tobytes() + slopes[b, m].numpy().tobytes() for m in range(len(views))]
        for b in range(len(shapes))
    ]


@pytest.mark.parametrize("kind", ["mesh", "points"])
@pytest.mark.parametrize("headlight", [True, False], ids=["headlight", "fixed light"])
@pytest.mark.parametrize("mode", ["edge-flow", "fd"])
def test_a_picture_has_the_same_bytes_in_any_company(kind, headlight, mode):
    """Alone, in a batch, in another order, with other views beside it, and its gradient too."""
    shapes = [with_points(shape, seed) for seed, shape in enumerate(SHAPES)]
    lights = None if headlight else np.stack([np.roll(SIDE_LIGHT, b) for b in range(4)])
    together = bytes_of(shapes, lights, kind=kind, mode=mode)
    order = [2, 0, 3, 1]
    shuffled = bytes_of(
        [shapes[b] for b in order],
        None if headlight else lights[order],
        kind=kind,
        views=VIEWS[::-1],
        mode=mode,
    )
    for place, b in enumerate(order):
        assert shuffled[place] == together[b][::-1]
    for b in range(4):
        alone = bytes_of([shapes[b]], None if headlight else lights[b : b + 1], kind=kind, views=VIEWS[1:2], mode=mode)
        assert alone[0][0] == together[b][1]


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="numba has one thread")
@pytest.mark.parametrize("kind", ["mesh", "points"])
@pytest.mark.parametrize("mode", ["edge-flow", "fd"])
def test_a_picture_has_the_same_bytes_with_one_thread_and_with_two(kind, mode):
    shapes = [with_points(shape, seed) for seed, shape in enumerate(SHAPES)]
    before, found = numba.get_num_threads(), []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            found.append(bytes_of(shapes, None, kind=kind, mode=mode))
    finally:
        numba.set_num_threads(before)
    assert found[0] == found[1]


def turned(shape, turns):
    """Return the shape turned by quarter turns about the y axis, towards +x from +z: exact in float32."""
    quarter = np.linalg.matrix_power(np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]), turns).astype(np.float32)
    return replace(shape, vertices=shape.vertices @ quarter.T, normals=shape.normals @ quarter.T), quarter


@pytest.mark.parametrize("turns", [1, 2, 3])
@pytest.mark.parametrize("shape", SHAPES, ids=["bumpy", "chair", "soup", "icosahedron"])
def test_turning_shape_light_and_camera_together_changes_nothing(shape, turns):
    """A corner may round to the next 1/256 of a sample; then pixels at its edges differ: 1 in 500 here."""
    look = scenes.look(32, light_direction=SIDE_LIGHT[None], supersample=2)
    moved, quarter = turned(shape, turns)
    views, after = cameras(*VIEWS), cameras(*((a + 90 * turns, e, d) for a, e, d in VIEWS))
    other = replace(look, light_direction=(quarter @ SIDE_LIGHT)[None])
    here, there = image(shape, views, look), image(moved, after, other)
    same = np.abs(here - there).max(axis=1) < 1e-5
    assert same.mean() > 0.998 and np.abs(here - there).max() < 0.05
    weights = np.random.default_rng(0).standard_normal(here.shape)
    slopes = [gradients(s, v, lk, weights) for s, v, lk in ((shape, views, look), (moved, after, other))]
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=1e-2, atol=1e-2 * np.abs(slopes[0][:, :2]).max())


@pytest.mark.parametrize("shape", SHAPES, ids=["bumpy", "chair", "soup", "icosahedron"])
def test_azimuth_has_no_seam(shape):
    """T1."""
    look = scenes.look(32, supersample=2)
    whole = image(shape, cameras(*((azimuth, 20, 2.2) for azimuth in (0, 360, -360, 3600))), look)
    assert (np.abs(whole - whole[0]).max(axis=1) < 1e-5).mean() > 0.995
    near = image(shape, cameras(*((azimuth, 20, 2.2) for azimuth in (359.999, -0.001, 0, 0.001))), look)
    assert np.abs(near[0] - near[1]).max() < 1e-2  # 359.999 has only 2e-5 degrees of float32 to spare
    inside = np.abs(np.diff(near, axis=0)).mean()
    elsewhere = image(shape, cameras((40.0, 20, 2.2), (40.001, 20, 2.2)), look)
    assert inside < 5e-4 and inside < 20 * np.abs(np.diff(elsewhere, axis=0)).mean() + 1e-4
    weights = np.tile(np.random.default_rng(0).standard_normal((1, 3, 32, 32)), (2, 1, 1, 1))
    slopes = gradients(shape, cameras((359.999, 20, 2.2), (-0.001, 20, 2.2)), look, weights)
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=0.02, atol=0.02 * np.abs(slopes[:, :2]).max())


@pytest.mark.parametrize("shape", SHAPES, ids=["bumpy", "chair", "soup", "icosahedron"])
def test_beyond_a_pole_the_picture_goes_on_upside_down(shape):
    """T2. From elevation 90 + x it is that from 90 - x on the other side, turned by half a turn."""
    look = scenes.look(32, light_direction=SIDE_LIGHT[None], supersample=2)
    for beyond in (-170.0, -95.0, 91.0, 130.0):
        within = (180.0 if beyond > 0 else -180.0) - beyond
        over, here = image(shape, cameras((35, beyond, 2.2), (215, within, 2.2)), look)
        assert (np.abs(over - here[:, ::-1, ::-1]).max(axis=0) < 1e-4).mean() > 0.99
        assert np.abs(over - here[:, ::-1, ::-1]).max() < 0.1
    for pole in (90.0, -90.0):
        views = image(shape, cameras((35, pole - 0.001, 2.2), (35, pole, 2.2), (35, pole + 0.001, 2.2)), look)
        assert np.abs(np.diff(views, axis=0)).mean() < 5e-4


def test_cameras_inside_on_a_vertex_and_far_away_give_finite_pictures():
    """T4."""
    shape, look = scenes.bumpy(6), scenes.look(24, supersample=2, specular=0.2)
    top = 0.5 / np.cos(np.arctan(0.02 / 0.5))  # where the top vertex is, seen from the middle
    angle = 90 - float(np.degrees(np.arctan(0.02 / 0.5)))
    views = cameras((10, 20, 0.05), (10, 20, 0.0), (0, angle, float(top)), (10, 20, 1e4), (10, 20, 1e6))
    drawn = image(shape, views, look)
    assert np.isfinite(drawn).all()
    assert (drawn[0] > 0.05).all() and (drawn[1] > 0.05).all()  # walls all around
    assert drawn[3].max() <= 1 and (drawn[3] > 0).any(axis=0).sum() <= 4  # a speck or nothing
    assert np.isfinite(gradients(shape, views, look, np.ones(drawn.shape))).all()


def test_no_gradient_is_carried_when_none_is_asked_for():
    for kind in ("mesh", "points"):
        look, views = scenes.look(12, kind=kind), cameras(*VIEWS, grad=True)
        assert not render(pack([with_points(SHAPES[0])]), views, look, gradient="none").rgb.requires_grad
        for mode in set(GRADIENTS) - {"none"}:
            assert render(pack([with_points(SHAPES[0])]), views, look, gradient=mode).rgb.requires_grad
            assert not render(pack([SHAPES[0]]), views.detach(), look, gradient=mode).rgb.requires_grad


def test_that_another_device_is_drawn_for_here_is_said_once(recwarn):
    say_where.cache_clear()
    for device in ("cuda", "cuda", "cpu"):
        say_where(device)
    assert [str(said.message) for said in recwarn] == ["pictures are drawn on the CPU and copied to cuda"]


def test_shading_alone_has_no_silhouettes():
    """Ambient light on a white shape: nothing changes but where its outline is."""
    look, weights = scenes.look(24, ambient=1.0, diffuse=0.0), np.ones((1, 3, 24, 24))
    views = cameras(VIEWS[0])
    assert np.abs(gradients(SHAPES[0], views, look, weights)).max() > 1e-3
    assert not gradients(SHAPES[0], views, look, weights, gradient="shading").any()


def test_an_unknown_gradient_is_refused():
    with pytest.raises(ValueError, match=r"gradient.*'soft'"):
        render(pack([SHAPES[0]]), cameras(VIEWS[0]), scenes.look(8), gradient="soft")


def test_a_shape_without_faces_is_refused_by_name():
    """T11: an empty mesh."""
    batch = pack([SHAPES[0], scenes.cloud(np.zeros((1, 3)))], names=["sofa/1", "chair/7"])
    with pytest.raises(DataError, match="chair/7") as refusal:
        render(batch, cameras(VIEWS[0], count=2), scenes.look(8, 2))
    assert "sofa/1" not in str(refusal.value) and "points" in refusal.value.hint
    render(batch, cameras(VIEWS[0], count=2), scenes.look(8, 2, kind="points"))


@pytest.mark.parametrize(
    ("kind", "shapes", "sets", "colors"),
    [
        pytest.param("mesh", 1, 2, 1),
        pytest.param("points", 1, 2, 1),
        pytest.param("points", 2, 1, 2),
        pytest.param("mesh", 2, 1, 2),
        pytest.param("mesh", 2, 2, 1),
        pytest.param("points", 2, 2, 1),
    ],
)
def test_cameras_or_colours_for_another_number_of_shapes_are_refused(kind, shapes, sets, colors):
    batch = pack([with_points(SHAPES[0])] * shapes)
    with pytest.raises(ValueError, match="shapes"):
        render(batch, cameras(VIEWS[0], count=sets), scenes.look(8, colors, kind=kind))


def test_shapes_with_different_numbers_of_points_make_no_batch():
    with pytest.raises(DataError, match=r"\[1, 50\]"):
        pack([SHAPES[0], with_points(SHAPES[1])])


@pytest.mark.parametrize(
    "changes",
    [
        {"kind": "points", "background": (1.0, 1.0, 1.0)},
        {"ambient": 0.0, "diffuse": 0.0},
        {"colors": np.zeros((1, 3), np.float32)},
        {"ambient": 1.0, "diffuse": 0.0, "background": (1.0, 1.0, 1.0)},
        {"kind": "points", "colors": np.float32([[0.2, 0.4, 0.6]]), "background": (0.2, 0.4, 0.6)},
    ],
    ids=[
        "white points on white",
        "no light on black",
        "black on black",
        "shadeless white on white",
        "blue on blue",
    ],
)
def test_looks_in_which_nothing_can_be_seen_are_refused(changes):
    with pytest.raises(UsageError) as refusal:
        check_look(scenes.look(8, **changes))
    assert refusal.value.hint


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"kind": "points"},
        {"ambient": 0.5, "diffuse": 0.3, "specular": 0.2, "background": (1.0, 1.0, 1.0)},
        {"kind": "points", "colors": np.float32([[0, 0, 1]])},
        {"ambient": 0.0, "diffuse": 0.0, "specular": 0.5},
    ],
    ids=["studio", "points", "paper: white on white, shaded", "blue points on black", "only a highlight"],
)
def test_looks_in_which_something_can_be_seen_are_accepted(changes):
    check_look(scenes.look(8, **changes))


@dataclass
class Settings:
    """What a configuration says about the look."""

    image_size: int = 16
    look: str = "studio"
    color: str = "random"
    light: str = "random"
    shading: str = "flat"
    supersample: int = 2
    point_radius: float = 0.03
    depth_cue: float = 0.0


@pytest.mark.parametrize("style", ["studio", "paper"])
@pytest.mark.parametrize("kind", ["mesh", "points"])
def test_looks_of_training_and_evaluation_are_visible_and_repeatable(style, kind):
    """Random colour and light come from the generator alone; evaluation is white under a headlight."""
    settings = Settings(look=style)
    first, second = (Look.training(settings, 5, kind, torch.Generator().manual_seed(3)) for _ in range(2))
    np.testing.assert_array_equal(first.colors, second.colors)
    np.testing.assert_array_equal(first.light_direction, second.light_direction)
    np.testing.assert_allclose(np.linalg.norm(first.light_direction, axis=1), 1, atol=1e-6)
    assert len(np.unique(first.colors, axis=0)) == 5 and first.colors.min() > 0 and first.colors.max() <= 1
    plain = Look.evaluation(settings, 5, kind)
    assert plain.light_direction is None and (plain.colors == 1).all() and plain.colors.shape == (5, 3)
    for look in (first, plain):
        check_look(look)
        assert (look.image_size, look.shading, look.supersample, look.point_radius) == (16, "flat", 2, 0.03)
    fixed = Look.training(replace(settings, color="white", light="headlight"), 5, kind, torch.Generator())
    assert fixed.light_direction is None and (fixed.colors == 1).all()
