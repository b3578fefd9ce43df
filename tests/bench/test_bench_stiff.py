"""The stiff set, and that its checks would notice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from mvtn_cli.console import Console
from mvtn_cli.core.bench import stiff_checks as check
from mvtn_cli.core.bench import stiff_shapes as made
from mvtn_cli.core.bench.plan import Plan
from mvtn_cli.core.bench.stiff import measure_stiff, run_case
from mvtn_cli.core.bench.stiff_cases import Case, stiff_cases
from mvtn_cli.core.bench.stiff_checks import Seen
from mvtn_cli.core.bench.subjects import spiral_cameras
from mvtn_cli.core.render import Look
from mvtn_cli.errors import DataError

SMALL = Plan(stiff_size=48)
CASES = [case for case in stiff_cases() if case.code != "T10"]


def seen(images: np.ndarray, gradient: np.ndarray, shape=made.box) -> Seen:
    look = Look(images.shape[-1], "mesh", np.ones((1, 3), np.float32), supersample=1)
    return Seen(shape(), spiral_cameras(len(images)), look, images, gradient)


def test_the_whole_stiff_set_is_finite_and_nothing_fails():
    outcome = measure_stiff(SMALL, Console(quiet=True), CASES)
    assert [row for row in outcome.rows if row["problem"]] == []
    assert outcome.summary == {"cases": len(outcome.rows), "failed": 0, "non_finite": 0}
    assert all(row["image_finite"] and row["gradient_finite"] for row in outcome.rows if row["case"] != "no faces")


def test_every_number_of_the_list_has_a_case_or_a_reason():
    codes = {case.code for case in stiff_cases()}
    reasons = {omitted["what"] for omitted in measure_stiff(SMALL, Console(quiet=True), []).omitted}
    assert codes | {"T13"} == {f"T{n}" for n in range(1, 17)} and "T13" in reasons
    assert len({(case.code, case.name) for case in stiff_cases()}) == len(stiff_cases())


def test_the_million_faces_are_a_million():
    case = next(case for case in stiff_cases() if case.code == "T10")
    assert case.size == 224
    assert len(made.bumpy(5).faces) == 4 * 5**2
    assert case.shape.args == (500,)  # type: ignore[attr-defined]


@pytest.mark.parametrize("broken", ["images", "gradient", "raises", "data"])
def test_what_a_renderer_gets_wrong_becomes_the_row_s_problem(broken, monkeypatch):
    from mvtn_cli.core.bench import stiff

    def draw(*given):
        if broken == "raises":
            raise RuntimeError("a kernel\nwent astray")
        if broken == "data":
            raise DataError("no faces to draw")
        images, gradient = np.zeros((2, 3, 4, 4)), np.zeros((2, 3))
        (images if broken == "images" else gradient)[1, 0] = np.nan
        return seen(images, gradient), 0.1

    monkeypatch.setattr(stiff, "_draw", draw)
    row = run_case(Case("T0", "toy", made.box), "flat", SMALL)
    words = {"images": "16 numbers are not finite", "gradient": "1 numbers are not finite"}
    words |= {"raises": "RuntimeError: a kernel went astray", "data": "no faces to draw"}
    assert row["problem"] == words[broken]
    assert (row["image_finite"], row["gradient_finite"]) == {
        "images": (False, True), "gradient": (True, False), "raises": (None, None), "data": (None, None),
    }[broken]  # fmt: skip


def test_a_shape_that_must_be_refused_is_a_failure_when_drawn():
    row = run_case(Case("T0", "toy", made.box, refused=True), "flat", SMALL)
    assert row["problem"] == "drawn, though there is nothing to draw"


def test_checks_notice_what_they_are_for():
    dark, bright = np.zeros((2, 3, 8, 8)), np.ones((2, 3, 8, 8))
    still, pulled = np.zeros((2, 3)), np.array([[1.0, 2, 3], [1, 2, 3]])
    assert check.background(seen(dark, still)) == ""
    assert check.background(seen(bright, still)) == "something is drawn"
    assert check.background(seen(dark, pulled)) == "the gradient is not zero"
    assert check.covered(seen(bright, still)) == ""
    assert check.covered(seen(dark, still)) == "128 pixels show the background"
    assert check.every_view_has_gradient(seen(dark, pulled)) == ""
    assert check.every_view_has_gradient(seen(dark, still)) == "2 views have no gradient"
    assert check.all_views_alike(seen(bright, pulled)) == ""
    assert "pictures" in check.all_views_alike(seen(np.stack([dark[0], bright[0]]), pulled))
    assert "gradients" in check.all_views_alike(seen(bright, pulled * [[1], [1.1]]))
    assert "the picture differs" in check.same_picture_as(made.chair)(seen(bright, still))


def test_a_gap_or_an_overlap_between_two_faces_is_noticed():
    square = [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]
    front = replace(seen(np.zeros((1, 3, 32, 32)), np.zeros((1, 3))), cameras=frontal())
    whole = made.raw(square, [[0, 1, 2], [0, 2, 3]])
    assert check.each_sample_once(replace(front, shape=whole)) == ""
    overlapping = made.with_faces(whole, [[0, 1, 2], [0, 1, 3]])
    assert "covered twice" in check.each_sample_once(replace(front, shape=overlapping))
    gaping = made.with_faces(whole, [[0, 1, 2], [0, 1, 2]])
    assert "not at all" in check.each_sample_once(replace(front, shape=gaping))


def frontal():
    cameras = spiral_cameras(1)
    return replace(cameras, azimuth_deg=torch.zeros(1, 1).double(), elevation_deg=torch.zeros(1, 1).double())
