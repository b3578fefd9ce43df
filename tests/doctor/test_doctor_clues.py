"""What a shape's geometry tells: copies, faces that look inwards, which way is up."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mvtn_cli.core.datasets import open_dataset
from mvtn_cli.core.preprocess.clues import LEAST, asymmetry, fingerprint, is_closed, up_axis, winding
from mvtn_cli.core.shapes import read_shape, sample_surface, validate

SEEDS = st.integers(0, 2**32 - 1)


def points(seed: int, count: int = 40) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3))


def everyday(count: int, split: str = "train") -> list:
    items = open_dataset(f"builtin:shapes?train={count}&test={count}").items
    return [validate(item.read())[0] for item in items if item.split == split]


@given(SEEDS, st.floats(1e-3, 1e3), st.lists(st.floats(-100, 100), min_size=3, max_size=3))
def test_order_repetition_place_and_scale_don_t_change_a_fingerprint(seed, scale, shift):
    rng = np.random.default_rng(seed)
    original = np.round(points(seed) * 1000) / 1024
    copy = np.vstack([original, original[:7]])[rng.permutation(47)]
    # A shift costs digits: coordinates that lie on a cell's border may then change side, so keep well off it.
    half = (original.max(0) - original.min(0)).max() / 2
    center = (original.max(0) + original.min(0)) / 2
    cells = (original - center) / half * 1e5
    moved = copy[np.isin(copy, original[(np.abs(cells - np.floor(cells) - 0.5) < 1e-2).any(1)]).sum(1) == 0]
    if len(np.unique(moved, axis=0)) == len(original):
        assert fingerprint(copy * scale + np.array(shift)) == fingerprint(original)
    assert fingerprint(copy) == fingerprint(original)


@given(SEEDS, st.integers(0, 39), st.integers(0, 2))
def test_a_point_that_moved_changes_a_fingerprint(seed, row, axis):
    original = points(seed)
    other = original.copy()
    other[row, axis] += 0.01 * np.ptp(original)
    assert fingerprint(other) != fingerprint(original)
    assert fingerprint(original[:, [1, 2, 0]]) != fingerprint(original)  # a turned shape is another input


def test_winding_follows_the_faces_for_every_made_shape():
    for shape in everyday(24):
        assert winding(shape.vertices, shape.faces) == "out"
        assert winding(shape.vertices, shape.faces[:, ::-1]) == "in"
        turned = shape.vertices[:, [2, 0, 1]] * 7 + 3  # neither turning, size nor place matters
        assert winding(turned, shape.faces) == "out"


def test_an_open_surface_is_told_if_it_is_clear_and_a_sheet_is_not():
    shape = next(shape for shape in everyday(24) if is_closed(shape.faces))
    most = shape.faces[: int(0.8 * len(shape.faces))]
    assert not is_closed(most)
    assert (winding(shape.vertices, most), winding(shape.vertices, most[:, ::-1])) == ("out", "in")
    sheet = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert winding(sheet, np.array([[0, 1, 2], [0, 2, 3]], np.int32)) == "unclear"
    both = np.vstack([shape.faces, shape.faces[:, ::-1]])
    assert winding(shape.vertices, both) == "unclear"


def test_a_real_mesh_that_is_known_to_be_inside_out_is_found(real_data):
    turned = {}
    for path in sorted((real_data / "modelnet_off").glob("*.off")):
        shape, _ = validate(read_shape(path, up="z"))
        turned[path.stem] = winding(shape.vertices, shape.faces)
    assert turned["chair_0890"] == "in" and turned["airplane_0003"] == "out"
    assert set(turned.values()) == {"in", "out", "unclear"}


@given(SEEDS)
def test_what_is_its_own_mirror_image_has_no_asymmetry(seed):
    half = points(seed) + 0.013
    x, y, z = asymmetry(np.vstack([half, half * [-1, 1, 1]]))
    assert x <= 2 / 80 and 0 <= y <= 1 and 0 <= z <= 1  # but for points on a border between slices


@pytest.mark.parametrize("up", [0, 1, 2])
def test_the_up_axis_is_found_whichever_it_is(up):
    order = np.roll([0, 1, 2], up - 1)  # where y goes
    values = [asymmetry(sample_surface(shape, 512, 0)[0][:, order]) for shape in everyday(36)]
    assert order.tolist().index(1) == up
    assert up_axis(np.array(values)) == "xyz"[up]
    assert up_axis(np.array(values[: LEAST - 1])) == ""  # a few shapes don't tell


def test_shapes_that_lie_any_way_tell_nothing():
    random = np.random.default_rng(0)
    turns = [np.linalg.qr(random.normal(size=(3, 3)))[0] for _ in range(48)]
    clouds = [sample_surface(shape, 512, 0)[0] for shape in everyday(48)]
    values = [asymmetry(cloud @ turn) for cloud, turn in zip(clouds, turns, strict=True)]
    assert up_axis(np.array(values)) == ""


def test_the_real_points_look_y_up(real_data):
    items = open_dataset(f"modelnet10:{real_data / 'modelnet40_points'}").items[::20]
    values = np.array([asymmetry(item.read().points) for item in items])
    assert up_axis(values) == "y"
    assert up_axis(values[:, [0, 2, 1]]) == "z"
