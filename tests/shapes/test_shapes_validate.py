"""Findings T17 to T21: what is mended, what is fatal, and that a clean shape is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from mvtn_cli.core.shapes import Shape, cloud, normalise, validate

BOX = trimesh.creation.box()


def mesh(vertices: object, faces: object, colors: object = None) -> Shape:
    rgb = None if colors is None else np.array(colors, np.float32).reshape(-1, 3)
    return Shape(np.array(vertices, np.float64).reshape(-1, 3), np.array(faces, np.int32).reshape(-1, 3), rgb)


def box() -> Shape:
    return mesh(BOX.vertices, BOX.faces)


def found(shape: Shape) -> list[tuple[str, int, bool]]:
    return [(finding.name, finding.count, finding.fatal) for finding in validate(shape)[1]]


def add(shape: Shape, vertices: object = (), faces: object = ()) -> Shape:
    more = mesh(vertices, faces)
    return replace(
        shape,
        vertices=np.concatenate([shape.vertices, more.vertices]),
        faces=np.concatenate([shape.faces, more.faces]),
    )


def test_a_clean_shape_comes_back_as_the_same_object() -> None:
    shape = box()
    mended, findings = validate(shape)
    assert mended is shape
    assert findings == []


def test_findings_say_mended_or_fatal_and_never_both() -> None:
    for shape in (add(box(), [[9, 9, 9]]), mesh([[0, 0, 0]], [])):
        for finding in validate(shape)[1]:
            assert finding.mended != finding.fatal
            assert finding.detail and finding.count > 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_faces_at_vertices_that_are_not_finite_are_dropped(bad: float) -> None:
    broken = add(box(), [[bad, 0, 0], [0, bad, bad]], [[0, 1, 8], [8, 9, 2]])
    mended, findings = validate(broken)
    assert [(f.name, f.count, f.fatal) for f in findings] == [("non-finite-vertices", 2, False)]
    assert np.array_equal(mended.vertices, box().vertices)
    assert np.array_equal(mended.faces, box().faces)
    everywhere = replace(box(), vertices=np.full((8, 3), bad))
    assert found(everywhere) == [("non-finite-vertices", 8, True)]


@pytest.mark.parametrize("index", [-1, -(2**31), 8, 2**31 - 1])
def test_an_index_out_of_range_is_fatal_and_nothing_is_indexed_with_it(index: int) -> None:
    broken = add(box(), (), [[0, 1, index], [2, index, index]])
    mended, findings = validate(broken)
    assert mended is broken
    assert [(f.name, f.count, f.fatal) for f in findings] == [("index-out-of-range", 2, True)]
    assert str(index) in findings[0].detail
    wide = replace(box(), faces=np.array([[0, 1, 2**40]], np.int64))
    assert found(wide) == [("index-out-of-range", 1, True)]


def test_unreferenced_vertices_are_removed_and_do_not_move_the_normalisation() -> None:
    far = add(box(), [[1e9, 0, 0], [0, -5, 0]])
    mended, findings = validate(far)
    assert [(f.name, f.count) for f in findings] == [("unreferenced-vertices", 2)]
    for shape in (far, mended):
        unit, center, radius = normalise(shape)
        assert center.tolist() == [0, 0, 0]
        assert radius == pytest.approx(np.sqrt(0.75))
        assert np.array_equal(unit.vertices[:8], normalise(box())[0].vertices)


def test_vertices_in_one_place_are_merged_and_file_order_is_kept() -> None:
    soup = mesh(BOX.vertices[BOX.faces].reshape(-1, 3), np.arange(36))
    shuffled = replace(soup, vertices=soup.vertices + np.random.default_rng(0).uniform(-1e-9, 1e-9, (36, 3)))
    for shape in (soup, shuffled):
        mended, findings = validate(shape)
        assert [(f.name, f.count) for f in findings] == [("duplicate-vertices", 28)]
        assert np.allclose(mended.vertices[mended.faces], soup.vertices[soup.faces], atol=1e-8)
        first_use = mended.faces.ravel()[np.sort(np.unique(mended.faces, return_index=True)[1])]
        assert first_use.tolist() == list(range(8))
        assert trimesh.Trimesh(mended.vertices, mended.faces, process=False).is_watertight


def test_vertices_a_little_apart_or_of_other_colour_are_not_merged() -> None:
    two = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [1 + 1e-6, 0, 0], [0, 1, 0]]
    colors = [[1, 0, 0]] * 5 + [[0, 0, 1]]
    shape = mesh(two, [[0, 1, 2], [3, 5, 4]], colors)
    assert found(shape) == []
    assert found(replace(shape, colors=None)) == [("duplicate-vertices", 1, False)]


def test_degenerate_faces_are_dropped_each_under_its_name() -> None:
    messy = add(box(), [[0, 0, 9], [0, 0, 9], [0, 0, 8]], [[0, 0, 1], [0, 8, 9], [8, 9, 10]])
    messy = add(messy, [[0.25, 0.5, 0.5], [0, 0.5, 0.5], [-0.25, 0.5, 0.5]], [[11, 12, 13]])
    messy = add(messy, (), [BOX.faces[0], BOX.faces[1][::-1], np.roll(BOX.faces[2], 1)])
    mended, findings = validate(messy)
    assert [(f.name, f.count, f.fatal) for f in findings] == [
        ("repeated-index-faces", 1, False),
        ("zero-area-faces", 3, False),
        ("duplicate-faces", 3, False),
    ]
    assert np.array_equal(mended.vertices, box().vertices)
    assert np.array_equal(mended.faces, box().faces)


def test_a_far_face_without_area_does_not_swallow_the_rest() -> None:
    """Against an extent of 1e9, the box would be merged into a point."""
    far = add(box(), [[0, 0, 0], [1e9, 0, 0], [5e8, 0, 0]], [[8, 9, 10]])
    mended, findings = validate(far)
    assert [(f.name, f.count) for f in findings] == [("zero-area-faces", 1)]
    assert np.array_equal(mended.vertices, box().vertices)
    assert np.array_equal(mended.faces, box().faces)


def test_slivers_of_aspect_one_million_are_kept_at_any_scale() -> None:
    for scale in (1e-12, 1.0, 1e12):
        assert found(mesh(np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0]]) * scale, [0, 1, 2])) == []


@pytest.mark.parametrize(
    ("shape", "name"),
    [
        (mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], []), "no-faces"),
        (mesh([], []), "no-faces"),
        (mesh([[3, 3, 3]] * 3, [0, 1, 2]), "single-point"),
        (mesh([[1e9, 0, 0], [1e9 + 1e-7, 0, 0], [1e9, 1e-7, 0]], [0, 1, 2]), "single-point"),
        (mesh([[0, 0, 0], [1, 1, 1], [3, 3, 3]], [0, 1, 2]), "zero-area-faces"),
        (mesh([[0, 0, 0], [1, 2, 3], [0.1, 0.2, 0.3]], [0, 1, 2]), "zero-area-faces"),
        (mesh([[0, 0, 0], [1, 1, 1]], [0, 1, 1]), "repeated-index-faces"),
        (mesh([[0, 0, 0], [1e305, 0, 0], [0, 1e305, 0]], [0, 1, 2]), "too-large"),
        (cloud(np.zeros((5, 3))), "single-point"),
        (cloud(np.array([[1.0, 2, 3]])), "single-point"),
        (cloud(np.zeros((0, 3))), "no-points"),
        (cloud(np.full((4, 3), np.nan)), "non-finite-points"),
        (Shape(np.zeros((4, 2)), np.zeros((1, 3), np.int32)), "malformed-arrays"),
        (Shape(np.zeros((4, 3)), np.zeros((1, 3))), "malformed-arrays"),
        (Shape(np.zeros((4, 3)), np.zeros((1, 3), int), np.zeros((3, 3), np.float32)), "malformed-arrays"),
    ],
)
def test_what_leaves_no_surface_is_fatal(shape: Shape, name: str) -> None:
    mended, findings = validate(shape)
    assert (findings[-1].name, findings[-1].fatal) == (name, True)
    assert mended is shape
    assert not any(finding.fatal for finding in findings[:-1])


def test_colours_beyond_their_range_are_clipped_and_follow_their_vertices() -> None:
    colors = np.tile(np.arange(9)[:, None] / 8, (1, 3))
    colors[3] = [2, -1, 0.5]
    shape = replace(add(box(), [[5, 5, 5]]), colors=np.roll(colors, 0).astype(np.float32))
    shape = replace(shape, vertices=np.roll(shape.vertices, 1, axis=0), faces=(shape.faces + 1).astype(np.int32))
    mended, findings = validate(shape)
    assert [(f.name, f.count) for f in findings] == [("colors-out-of-range", 1), ("unreferenced-vertices", 1)]
    assert mended.colors is not None
    assert np.allclose(mended.colors[[0, 2, 7]], [[1 / 8] * 3, [1, 0, 0.5], [1] * 3])


floats = st.floats(width=64, allow_nan=True, allow_infinity=True)


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_validate_never_raises_and_what_it_passes_is_sound_and_stays_sound(data: st.DataObject) -> None:
    some = st.one_of(floats, st.sampled_from([0.0, 1.0, -1.0, 1e-300, 1e300]))
    vertices = data.draw(st.lists(st.tuples(some, some, some), max_size=8))
    index = st.integers(-1, len(vertices)) if data.draw(st.booleans()) else st.integers(0, max(len(vertices) - 1, 0))
    shape = mesh(vertices, data.draw(st.lists(st.tuples(index, index, index), max_size=8)))
    mended, findings = validate(shape)
    if any(finding.fatal for finding in findings):
        assert mended is shape
        return
    assert np.isfinite(mended.vertices).all()
    assert np.array_equal(np.unique(mended.faces), np.arange(len(mended.vertices)))
    unit, _, radius = normalise(mended)
    assert 0 < radius < np.inf
    assert np.linalg.norm(unit.vertices, axis=1).max() == pytest.approx(1)
    assert {finding.name for finding in validate(mended)[1]} <= {"duplicate-vertices"}  # the grid may shift
