"""`builtin:one-sided`: the side that tells the class is known, alone, and deducible."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mvtn_cli.core.datasets.builtin import one_sided
from mvtn_cli.core.datasets.builtin.mesh import Mesh
from mvtn_cli.core.datasets.builtin.one_sided import CLASSES, barrel, draw_body
from mvtn_cli.core.datasets.builtin.shapes import shape_rng
from mvtn_cli.core.shapes import split_creases, validate, vertex_normals

LABELS = range(len(CLASSES))
MANTLE = 36 * 17


def body(index: int = 0) -> one_sided.Body:
    return draw_body(shape_rng(0, "train", "one-sided", index))


def off_front_deg(mesh: Mesh) -> np.ndarray:
    """Angle of each vertex (V,) to +z, 0 to 180, measured on the upright barrel without slant and lean."""
    reference = barrel(replace(body(), slant=0.0, lean=0.0, amplitude=0.0), 0)
    assert len(reference.vertices) == len(mesh.vertices)
    return np.abs(np.degrees(np.arctan2(reference.vertices[:, 0], reference.vertices[:, 2])))


def test_from_behind_all_classes_are_one_and_from_the_front_each_is_its_own() -> None:
    for index in range(4):
        meshes = [barrel(body(index), label) for label in LABELS]
        angle = off_front_deg(meshes[0])
        for label in LABELS[1:]:
            moved = np.linalg.norm(meshes[label].vertices - meshes[0].vertices, axis=1)
            assert np.array_equal(meshes[label].faces, meshes[0].faces)
            assert moved[angle > 55.01].max() == 0
            assert moved[angle < 50].max() > 0.03
        flat = barrel(replace(body(index), amplitude=0.0), 0)
        behind = angle > 100
        assert behind.sum() > 150
        assert all(np.array_equal(mesh.vertices[behind], flat.vertices[behind]) for mesh in meshes)


def test_each_relief_rises_by_about_its_amplitude_and_no_more() -> None:
    for label in LABELS:
        heights = np.array([one_sided.relief(body(index), label).max() for index in range(20)])
        assert heights.min() > 0.75
        assert heights.max() < 1.25
        assert one_sided.relief(body(), label).min() >= 0


def test_turning_back_by_the_known_azimuth_brings_the_relief_to_plus_z() -> None:
    for index in range(12):
        shape, label = one_sided.build(index, seed=3)
        drawn = draw_body(shape_rng(3, "train", "one-sided", index))
        assert shape.known_azimuth_deg == drawn.azimuth_deg
        back = Mesh(shape.vertices, shape.faces).turned("y", -shape.known_azimuth_deg)
        assert back.vertices == pytest.approx(barrel(drawn, label).vertices, abs=1e-12)
        # And in the words of the cameras: what the relief moved looks towards (sin a, 0, cos a).
        flat = barrel(replace(drawn, amplitude=0.0), label).turned("y", drawn.azimuth_deg)
        moved = (shape.vertices - flat.vertices).sum(0)
        a = np.radians(shape.known_azimuth_deg)
        assert moved @ [np.sin(a), 0, np.cos(a)] > 0.9 * np.linalg.norm(moved)


def test_the_body_alone_tells_its_front() -> None:
    """The rim's lowest vertex lies at the front, and the barrel leans away from it."""
    for index in range(12):
        drawn = replace(body(index), amplitude=0.0)
        mesh = barrel(drawn, 0).turned("y", drawn.azimuth_deg)
        rim = mesh.vertices[:MANTLE].reshape(36, 17, 3)[:, -1]
        foot = mesh.vertices[:MANTLE].reshape(36, 17, 3)[:, 0]
        a = np.radians(drawn.azimuth_deg)
        front = np.array([np.sin(a), 0, np.cos(a)])
        lowest = rim[rim[:, 1].argmin()] - rim.mean(0)
        assert lowest @ front == pytest.approx(np.linalg.norm(lowest * [1, 0, 1]), rel=1e-6)
        assert (rim.mean(0) - foot.mean(0)) @ front < -0.09


def test_the_front_is_everywhere_equally_often() -> None:
    azimuth = np.radians([one_sided.build(index)[0].known_azimuth_deg for index in range(360)])
    assert np.abs(np.exp(1j * azimuth).mean()) < 0.15  # 2.8 sigma for 360 draws
    assert np.histogram(azimuth, bins=8, range=(-np.pi, np.pi))[0].min() > 20


def test_the_mesh_is_closed_outward_and_shaded_smoothly_with_flat_caps() -> None:
    mesh = barrel(body(), 3)
    corners = mesh.vertices[mesh.faces]
    assert (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6 > 0.3
    edges = {tuple(edge) for i in range(3) for edge in mesh.faces[:, [i, (i + 1) % 3]].tolist()}
    assert len(edges) == 3 * len(mesh.faces)
    assert edges == {(b, a) for a, b in edges}

    plain = barrel(replace(body(), amplitude=0.0), 3)
    origin, faces = split_creases(plain.vertices, plain.faces)
    assert len(origin) == len(plain.vertices) + 2 * 36  # both rims are creases, nothing else is
    normals = vertex_normals(plain.vertices[origin], faces)
    foot, rim = normals[faces[-72:-36]], normals[faces[-36:]]
    assert foot == pytest.approx(np.tile([0, -1, 0], (36, 3, 1)), abs=1e-6)
    assert rim == pytest.approx(np.tile(rim[0, 0], (36, 3, 1)), abs=1e-6)
    assert rim[0, 0, 2] > 0.1  # the slanted top looks up and forward


def test_shapes_are_valid_deterministic_and_take_turns_in_class() -> None:
    built = [one_sided.build(index, seed=1, split="test") for index in range(12)]
    assert [label for _, label in built] == [*LABELS, *LABELS]
    for index, (shape, _) in enumerate(built):
        assert validate(shape)[1] == []
        assert np.array_equal(shape.vertices, one_sided.build(index, seed=1, split="test")[0].vertices)
        assert not np.allclose(shape.vertices, one_sided.build(index, seed=1, split="train")[0].vertices)
        assert not np.allclose(shape.vertices, one_sided.build(index, seed=2, split="test")[0].vertices)
