"""Each measurement on tiny images: does it see what is right, and what is wrong?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from mvtn_cli.console import Console, Ticker
from mvtn_cli.core.bench import gradient as gradient_bench
from mvtn_cli.core.bench.cost import measure_cost
from mvtn_cli.core.bench.gradient import judged, measure_gradient
from mvtn_cli.core.bench.image import measure_image
from mvtn_cli.core.bench.modes import DEFAULT_MODE, Mode, all_modes, angle_gradient, modes_of
from mvtn_cli.core.bench.plan import Plan, TruthSetting
from mvtn_cli.core.bench.pose import measure_pose
from mvtn_cli.core.bench.subjects import DRAWN, builtin_subjects, cameras_at, golden_spiral, look_at
from mvtn_cli.core.bench.truth import lattice_shifts, shifted_matrices, true_gradient, views_at_once
from mvtn_cli.core.bench.weights import smooth_weights
from mvtn_cli.core.render import GRADIENTS, pack
from mvtn_cli.core.render.mesh import MeshScene

QUIET = Console(quiet=True)
TINY = Plan(
    image_size=24,
    num_views=3,
    smooth_truth=(TruthSetting(6, 2, 0.5), TruthSetting(5, 2, 0.7)),
    sharp_truth=(TruthSetting(6, 2, 0.5), TruthSetting(5, 2, 0.7)),
    repeats=1,
    pose_steps=40,
    image_truths=(16, 13),
    batch_shapes=2,
)


@pytest.fixture(scope="module")
def subjects():
    return builtin_subjects(2)


def test_built_in_subjects_are_distinct_meshes_in_the_unit_ball_and_no_spheres():
    made = builtin_subjects(8)
    assert len({subject.name for subject in made}) == 8
    for subject in made:
        radii = np.linalg.norm(subject.shape.vertices, axis=1)
        assert subject.faces > 100 and radii.max() == pytest.approx(1, abs=1e-5) and radii.min() < 0.8


def test_the_first_look_is_white_under_a_headlight_the_second_coloured_under_a_fixed_light(subjects):
    white, colored, mixed = (look_at(pair, Plan(image_size=8)) for pair in (subjects[:1], subjects[1:], subjects))
    assert white.light_direction is None and (white.colors == 1).all()
    assert colored.light_direction is not None and not (colored.colors == 1).all()
    assert mixed.light_direction is not None and mixed.light_direction.shape == (2, 3)
    assert np.allclose(np.linalg.norm(mixed.light_direction, axis=1), 1)
    assert np.allclose(mixed.light_direction[1], colored.light_direction[0])


@pytest.mark.parametrize("number", [0, 1])
def test_the_truth_is_what_the_default_mode_finds_at_many_samples(subjects, number):
    """Two independent ways to one number: differences of images, and the analytic reduction at 8x8 samples."""
    subject = subjects[number]
    batch, look, spiral = pack([subject.shape]), look_at([subject], Plan(image_size=48)), golden_spiral(2)
    x, y = torch.meshgrid(torch.linspace(0, 5, 48), torch.linspace(0, 4, 48), indexing="ij")
    waves = torch.stack([torch.cos(x + y), torch.sin(2 * x - y), torch.cos(y)]).repeat(2, 1, 1, 1)
    truth = true_gradient(batch, *spiral, look, {"w": waves, "2w": 2 * waves}, TruthSetting(8, 8, 0.1), Ticker())
    found = angle_gradient(batch, cameras_at(*spiral), look, Mode(DEFAULT_MODE, 8), waves[None])[0].numpy()
    figures = judged(found, truth["w"])
    assert figures["l2"] < 0.04 and figures["G"] > 0.999 and figures["cosine"] > 0.999
    assert np.allclose(truth["2w"], 2 * truth["w"])


@pytest.mark.parametrize(
    ("radius", "samples", "l2"), [(0.14, 1, 0.01), (0.03, 1, 0.01), (0.14, 6, 0.25), (0.03, 6, 0.6)]
)
@pytest.mark.parametrize("number", [0, 1])
def test_the_gradient_of_points_is_exact_for_their_image_and_near_that_of_a_finer_one(
    subjects, number, radius, samples, l2
):
    """White and coloured points of 3 pixels and of half a pixel, as 0.03 and 0.006 are at 224."""
    batch, spiral = pack([subjects[number].shape]), golden_spiral(3)
    look = look_at([subjects[number]], Plan(image_size=48), kind="points", point_radius=radius)
    weights = smooth_weights(3, 48, seed=1)
    setting = TruthSetting(samples, 1, 0.05)
    truth = true_gradient(batch, *spiral, look, {"w": weights}, setting, Ticker())["w"]
    (mode,) = modes_of(look)
    found, elsewhere = (
        angle_gradient(batch, cameras_at(spiral[0] + off, spiral[1]), look, mode, weights[None])[0].numpy()
        for off in (0, 20)
    )
    assert judged(found, truth)["l2"] < l2 < judged(elsewhere, truth)["l2"]


def test_lattices_lie_around_the_plain_one_and_meet_a_vertical_edge_in_as_many_places_as_there_are():
    shifts = lattice_shifts(TruthSetting(8, 16, 0.1))
    assert shifts.shape == (16, 2) and np.abs(shifts.mean(axis=0)).max() < 1e-12
    assert np.abs(shifts).max() < 0.6 / 8  # half a sample, and a little for the centring
    assert np.allclose(np.diff(np.sort(shifts[:, 0])), 1 / 128)
    assert np.diff(np.sort(shifts[:, 1])).max() < 2 / 128
    assert np.array_equal(lattice_shifts(TruthSetting(8, 1, 0.1)), [[0, 0]])


def test_a_shift_by_whole_pixels_is_the_same_picture_elsewhere(subjects):
    scene = MeshScene(pack([subjects[0].shape]), look_at(subjects[:1], Plan(image_size=32)), 60.0)
    angles = np.array([[30.0, 20.0]])
    plain = scene.images(shifted_matrices(angles, np.zeros(2)))[0, 0]
    moved = scene.images(shifted_matrices(angles, np.array([1.0, 2.0]) / scene.focal))[0, 0]
    assert plain.max() > 0.5 and np.allclose(np.roll(plain, (2, -1), axis=(1, 2)), moved, atol=1e-6)


def test_the_truth_does_not_depend_on_how_many_views_are_drawn_at_once(subjects, monkeypatch):
    batch, look = pack([subjects[0].shape]), look_at(subjects[:1], Plan(image_size=16))
    weights = {"smooth": smooth_weights(2, 16, seed=0)}
    found = []
    for at_once in (1, 3):
        monkeypatch.setattr("mvtn_cli.core.bench.truth.views_at_once", lambda side, n=at_once: n)
        found.append(
            true_gradient(batch, *golden_spiral(2), look, weights, TruthSetting(4, 2, 0.5), Ticker())["smooth"]
        )
    assert np.array_equal(found[0], found[1])


def test_views_are_drawn_one_at_a_time_where_memory_is_short():
    assert views_at_once(10**6) == 1
    assert views_at_once(1) >= 1


def test_gradient_rows_cover_every_mesh_shading_weight_and_mode(subjects):
    outcome = measure_gradient(subjects, TINY, QUIET)
    modes = [mode.name for mode in all_modes()]
    assert modes[0] == DEFAULT_MODE and f"{DEFAULT_MODE} ss2" in modes
    assert {mode.gradient for mode in all_modes()} == set(GRADIENTS) - {"none"}
    names = [(row["mesh"], row["shading"], row["weights"], row["mode"]) for row in outcome.rows]
    assert len(set(names)) == len(names) == 3 * 3 * (2 * len(modes) + 3)
    assert {row["shading"] for row in outcome.rows} == set(DRAWN)
    assert all(np.isfinite(row[name]) for row in outcome.rows for name in gradient_bench.NUMBERS)
    assert all(row["seconds"] > 0 and -1 <= row["cosine"] <= 1 for row in outcome.rows)
    mean = next(row for row in outcome.rows if row["mesh"] == "mean")
    first = [row for row in outcome.rows if row["mesh"] != "mean" and row["mode"] == DEFAULT_MODE]
    same = [row["l2"] for row in first if row["weights"] == row["shading"] == "smooth"]
    assert mean["l2"] == pytest.approx(np.mean(same)) and outcome.summary["l2_mean"] == mean["l2"]
    assert set(outcome.summary) >= {"default_mode", "cosine_mean", "l2_mean", "backbone_ratio"}


def test_more_samples_bring_the_image_nearer_to_the_truth(subjects):
    outcome = measure_image(subjects[:1], TINY, QUIET)
    means = [row for row in outcome.rows if row["mesh"] == "mean"]
    assert len(means) == 2 * 2 * 3 and len(outcome.rows) == 2 * len(means)
    for shading in ("smooth", "flat"):
        errors = [row["rmse"] for row in means if row["shading"] == shading and row["image_size"] == 24]
        assert errors[0] > errors[1] > errors[2] > 0
        assert errors[2] > next(row["truth_rmse"] for row in means if row["shading"] == shading)
    assert outcome.summary["rmse_1"] > outcome.summary["rmse_4"]


def test_pose_recovery_counts_views_and_names_those_that_failed(subjects):
    plan = replace(TINY, image_size=48)
    outcome = measure_pose(subjects[:1], plan, QUIET)
    modes = [mode.name for mode in all_modes() if mode.supersample == 1]
    assert [row["mode"] for row in outcome.rows] == modes * 2 and outcome.rows[-1]["mesh"] == "all"
    for row in outcome.rows[: len(modes)]:
        missed = [failure for failure in outcome.notes["failures"] if failure["mode"] == row["mode"]]
        assert row["within_1deg"] + len(missed) == row["of"] == 3
        assert all(failure["error_deg"] > 1 and 4 < failure["start_deg"] < 25 for failure in missed)
    assert outcome.rows[0]["median_deg"] < 2  # it started at about 14
    assert set(outcome.summary) >= {"within_1deg", "of"} and outcome.summary["of"] == 3


def test_costs_are_told_for_each_setting_and_thread_count_and_for_a_packed_call(subjects, monkeypatch):
    monkeypatch.setattr("mvtn_cli.core.bench.cost.most_threads", lambda: 1)
    threads = torch.get_num_threads()
    outcome = measure_cost(subjects[:1], subjects[0], TINY, QUIET, counts=(1, 2))
    assert torch.get_num_threads() == threads
    single = [row for row in outcome.rows if row["what"] == "views"]
    assert [(row["shading"], row["supersample"], row["threads"]) for row in single] == [
        *(("smooth", 1, 1), ("flat", 1, 1), ("smooth", 2, 1), ("points 0.015", 1, 1))
    ]
    for row in single:
        assert row["seconds"] == pytest.approx(row["forward"] + row["backward"])
        assert row["ratio"] == pytest.approx(row["seconds"] / row["resnet"]) and row["ratio"] > 0
    assert outcome.summary["backbone_ratio"] == single[0]["ratio"]
    assert outcome.summary["thread_speedup"] is None
    assert [omitted["what"] for omitted in outcome.omitted] == ["2 threads"]
    assert [row["what"] for row in outcome.rows[4:]] == ["one call", "single calls"]
    assert outcome.rows[-1]["views"] == 2 * TINY.num_views and outcome.rows[-1]["ratio"] == 1
