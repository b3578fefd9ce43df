"""`builtin:shapes`: what a set of made everyday shapes must keep."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mvtn_cli.core.datasets.builtin import shapes
from mvtn_cli.core.shapes import Shape, validate
from mvtn_cli.errors import UsageError


@pytest.fixture(scope="module")
def samples() -> dict[str, list[Shape]]:
    return {name: [shapes.build(name, index) for index in range(12)] for name in shapes.CLASSES}


def test_there_are_twelve_classes_in_alphabetical_order() -> None:
    assert len(shapes.CLASSES) == 12
    assert list(shapes.CLASSES) == sorted(shapes.CLASSES)


@pytest.mark.parametrize("name", shapes.CLASSES)
def test_every_shape_is_a_light_and_faultless_mesh(name: str, samples: dict[str, list[Shape]]) -> None:
    for shape in samples[name]:
        assert 100 <= len(shape.faces) <= 3000
        assert np.isfinite(shape.vertices).all()
        assert set(np.unique(shape.faces)) == set(range(len(shape.vertices)))
        corners = shape.vertices[shape.faces]
        doubled_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        assert doubled_area.min() > 1e-9 * doubled_area.max()
        assert validate(shape)[1] == []
        assert shape.colors is None


@pytest.mark.parametrize("name", shapes.CLASSES)
def test_the_four_arguments_decide_every_coordinate(name: str) -> None:
    first = shapes.build(name, 3, seed=5, split="train")
    again = shapes.build(name, 3, seed=5, split="train")
    assert np.array_equal(first.vertices, again.vertices)
    assert np.array_equal(first.faces, again.faces)
    for other in (
        shapes.build(name, 4, seed=5, split="train"),
        shapes.build(name, 3, seed=6, split="train"),
        shapes.build(name, 3, seed=5, split="test"),
    ):
        same = other.vertices.shape == first.vertices.shape and np.allclose(other.vertices, first.vertices)
        assert not same


@pytest.mark.parametrize("name", shapes.CLASSES)
def test_a_class_varies_in_its_parts_and_proportions(name: str, samples: dict[str, list[Shape]]) -> None:
    face_counts = {len(shape.faces) for shape in samples[name]}
    extents = np.array([np.ptp(shape.vertices, axis=0) for shape in samples[name]])
    slenderness = extents[:, 1] / np.linalg.norm(extents[:, [0, 2]], axis=1)
    assert len(face_counts) >= 4
    assert slenderness.max() / slenderness.min() > 1.2


def test_shapes_stand_up_and_are_turned_about_the_vertical_only() -> None:
    """A table's top is its highest part, horizontal, and its edges point anywhere."""
    headings = []
    for index in range(8):
        table = shapes.build("table", index)
        top = table.vertices[table.vertices[:, 1] > table.vertices[:, 1].max() - 1e-9]
        flat = top[:, [0, 2]] - top[:, [0, 2]].mean(0)
        assert len(top) > 20
        headings.append(np.arctan2(*np.linalg.svd(flat)[2][0]))
    assert np.std(headings) > 0.2


@pytest.mark.parametrize("name", shapes.CLASSES)
def test_every_closed_part_looks_outwards(name: str, samples: dict[str, list[Shape]]) -> None:
    for shape in samples[name]:
        volumes = _volumes_of_closed_parts(shape)
        assert len(volumes) >= 1
        assert min(volumes) > 0


def _volumes_of_closed_parts(shape: Shape) -> list[float]:
    """Weld by place, split into connected parts, leave out the open ones; a part inside out is negative."""
    count = len(shape.vertices)
    near = cKDTree(shape.vertices).query_pairs(2e-5 * np.ptp(shape.vertices), output_type="ndarray")
    faces = _components(near, count)[shape.faces]
    edges = np.concatenate([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    part = _components(edges, count)[faces[:, 0]]
    volumes = []
    for k in np.unique(part):
        own = faces[part == k]
        directed = Counter(tuple(edge) for i in range(3) for edge in own[:, [i, (i + 1) % 3]].tolist())
        if all(directed[b, a] == count for (a, b), count in directed.items()):
            corners = shape.vertices[shape.faces[part == k]]
            corners = corners - corners.reshape(-1, 3).mean(0)
            volumes.append(float((corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6))
    return volumes


def _components(pairs: np.ndarray, count: int) -> np.ndarray:
    links = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return connected_components(links, directed=False)[1]


def test_an_unknown_class_names_the_nearest() -> None:
    with pytest.raises(UsageError, match="did you mean 'chair'"):
        shapes.build("chairs", 0)
