"""Turning, noise, thinning and size: what they keep, and what chance may depend on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.distance import pdist
from solids import Toy, cloud, solid

from mvtn_cli.core.render.topology import topology_of
from mvtn_cli.core.robustness import CorruptedShapes, Corruption, shape_generator
from mvtn_cli.core.robustness.disturbing import scaled, with_noise, without_points
from mvtn_cli.core.robustness.turning import draw_angle, draw_rotation, turn_about_y, turned

few = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32 - 1)
RANDOM = [
    Corruption("rotate", 90.0, seed=3),
    Corruption("so3", seed=3),
    Corruption("noise", 0.05, seed=3),
    Corruption("drop-points", 0.5, seed=3),
]


@few
@given(seeds)
def test_turning_keeps_distances_and_normals_and_handedness(seed: int):
    random = np.random.default_rng(seed)
    shape = solid(seed % 20)
    for rotation in (turn_about_y(draw_angle(180, random)), draw_rotation(random)):
        assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12) and np.linalg.det(rotation) > 0
        moved = turned(shape, rotation)
        for one, other in ((moved.vertices, shape.vertices), (moved.points, shape.points)):
            assert np.allclose(pdist(one.astype(float)), pdist(other.astype(float)), atol=1e-6)
        assert np.allclose(np.linalg.norm(moved.normals, axis=1), 1, atol=1e-6)
        assert np.array_equal(moved.faces, shape.faces) and moved.colors is shape.colors


def test_turning_about_y_goes_the_way_of_the_azimuth_and_keeps_heights():
    assert np.allclose(turn_about_y(90) @ [0, 0, 1], [1, 0, 0])
    moved = turned(solid(1), turn_about_y(37))
    assert np.array_equal(moved.vertices[:, 1], solid(1).vertices[:, 1])


def test_seams_between_equal_vertices_stay_closed_when_turned():
    shape = solid(2, seams=True)
    moved = turned(shape, draw_rotation(np.random.default_rng(0)))
    assert len(np.unique(moved.vertices, axis=0)) == len(np.unique(shape.vertices, axis=0))
    assert topology_of(moved).solid.all() == topology_of(shape).solid.all()


@few
@given(seeds, st.floats(0.001, 180))
def test_angles_stay_within_the_range_that_was_asked_for(seed: int, limit: float):
    random = np.random.default_rng(seed)
    assert all(abs(draw_angle(limit, random)) <= limit for _ in range(50))


def test_angles_are_uniform_and_rotations_take_up_uniformly_to_everywhere():
    random = np.random.default_rng(0)
    angles = [draw_angle(90, random) for _ in range(2000)]
    assert stats.kstest(angles, stats.uniform(-90, 180).cdf).pvalue > 0.01
    ups = np.array([draw_rotation(random)[:, 1] for _ in range(2000)])  # a uniform direction has uniform coordinates
    for axis in range(3):
        assert stats.kstest(ups[:, axis], stats.uniform(-1, 2).cdf).pvalue > 0.01
    turns = [np.degrees(np.arccos((np.trace(draw_rotation(random)) - 1) / 2)) for _ in range(2000)]
    density = lambda t: (np.radians(t) - np.sin(np.radians(t))) / np.pi  # noqa: E731 -- Haar measure of SO(3)
    assert stats.kstest(turns, density).pvalue > 0.01


@pytest.mark.parametrize("corruption", RANDOM, ids=lambda c: c.kind)
def test_a_shape_is_corrupted_alike_alone_in_any_order_and_in_any_subset(corruption: Corruption):
    served = [CorruptedShapes(Toy(), corruption, capacity=n) for n in (1, 4, 99)]
    orders = [[5, 3, 9], [9, 5, 5, 3], [3]]
    seen = [{i: shapes.load(i) for i in order} for shapes, order in zip(served, orders, strict=True)]
    for name in ("vertices", "points", "normals"):
        assert np.array_equal(getattr(seen[0][3], name), getattr(seen[1][3], name))
        assert np.array_equal(getattr(seen[0][3], name), getattr(seen[2][3], name))
    assert np.array_equal(seen[0][9].points, seen[1][9].points)
    moved = Toy()
    moved.records = moved.records[8:] + moved.records[:8]  # the name decides, not the place in the list
    moved.load = lambda i: Toy().load((i + 8) % 16)
    assert np.array_equal(CorruptedShapes(moved, corruption).load(11).points, seen[0][3].points)


@pytest.mark.parametrize("corruption", RANDOM, ids=lambda c: c.kind)
def test_seed_repeat_and_shape_each_change_the_draw(corruption: Corruption):
    def points(corruption: Corruption, name: str = "a") -> np.ndarray:
        return corruption.apply(solid(0), name).shape.points

    same = points(corruption)
    assert np.array_equal(points(corruption), same)
    for other in (replace(corruption, seed=4), replace(corruption, repeat=1)):
        assert not np.array_equal(points(other), same)
    assert not np.array_equal(points(corruption, "b"), same)


def test_the_strength_does_not_change_the_draw():
    draws = [draw_angle(limit, shape_generator(1, 2, "a")) / limit for limit in (15, 90, 180)]
    assert np.ptp(draws) < 1e-12
    weak, strong = (with_noise(solid(0), sd, shape_generator(1, 2, "a")).points for sd in (0.01, 0.02))
    assert np.allclose(strong - solid(0).points, 2 * (weak - solid(0).points), atol=1e-6)


def test_noise_has_the_size_that_was_asked_for_and_does_not_tear_the_surface():
    shape = solid(4, seams=True, points=20_000)
    noisy = with_noise(shape, 0.02, np.random.default_rng(0))
    assert (noisy.points - shape.points).std() == pytest.approx(0.02, rel=0.03)
    assert (noisy.vertices - shape.vertices).std() == pytest.approx(0.02, rel=0.2)
    assert len(np.unique(noisy.vertices, axis=0)) == len(np.unique(shape.vertices, axis=0))
    assert np.allclose(np.linalg.norm(noisy.normals, axis=1), 1, atol=1e-5)
    assert not np.array_equal(noisy.normals, shape.normals)


@few
@given(seeds, st.floats(0.01, 0.98))
def test_dropping_points_removes_its_share_and_more_removes_the_same_and_more(seed: int, share: float):
    shape = cloud(seed % 20)
    kept = [
        {tuple(row) for row in without_points(shape, s, np.random.default_rng(seed)).shape.points.tolist()}
        for s in (share, min(0.99, share * 1.3))
    ]
    assert abs(64 - len(kept[0]) - share * 64) <= 1
    assert kept[1] <= kept[0] <= {tuple(row) for row in shape.points.tolist()}
    assert without_points(shape, share, np.random.default_rng(seed)).shape.points.shape == shape.points.shape


def test_dropping_points_leaves_a_mesh_alone():
    shape = solid(1)
    left = without_points(shape, 0.5, np.random.default_rng(0))
    assert left.shape.vertices is shape.vertices and left.points_left == 0.5


def test_size_changes_all_distances_alike():
    small = scaled(solid(1), 0.5)
    assert np.allclose(small.vertices, 0.5 * solid(1).vertices) and np.allclose(small.points, 0.5 * solid(1).points)
    assert np.array_equal(small.normals, solid(1).normals)


@pytest.mark.parametrize(
    "nothing",
    [
        Corruption("clean"),
        Corruption("noise", 0.0),
        Corruption("drop-points", 0.0),
        Corruption("scale", 1.0),
        Corruption("occlude", 0.0, "+x", "quantile"),
    ],
    ids=lambda c: c.kind,
)
def test_no_strength_gives_the_very_same_shape(nothing: Corruption):
    for shape in (solid(1), cloud(1)):
        assert nothing.apply(shape, "a").shape is shape


@pytest.mark.parametrize("corruption", [*RANDOM, Corruption("occlude", 0.6, "-y", "extent")], ids=lambda c: c.kind)
def test_a_corrupted_shape_is_drawn_by_its_own_topology_and_stays_what_it_was(corruption: Corruption):
    shape = solid(1)
    topology_of(shape)  # kept with the shape from now on
    found = corruption.apply(shape, "a").shape
    assert len(topology_of(found).face_edges) == len(found.faces) and found.has_mesh
    if found.vertices is not shape.vertices and corruption.kind != "drop-points":
        assert topology_of(found) is not topology_of(shape)
    assert not corruption.apply(cloud(1), "a").shape.has_mesh
