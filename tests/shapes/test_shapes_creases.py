"""Smooth shading must round off what is round and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mvtn_cli.core.shapes import split_creases, vertex_normals


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("flip", [False, True])
def test_the_corners_of_a_box_have_the_normals_of_its_sides(flip: bool) -> None:
    box = trimesh.creation.box(extents=(1, 2, 3))
    vertices, faces = np.array(box.vertices), np.array(box.faces, np.int32)
    if flip:  # half of the triangles wound inside out
        faces[::2] = faces[::2, ::-1]
    origin, split = split_creases(vertices, faces)
    assert np.array_equal(vertices[origin][split], vertices[faces])
    normals = vertex_normals(vertices[origin], split)
    aligned = np.abs((normals[split] * face_normals(vertices, faces)[:, None]).sum(-1))
    assert len(origin) == 24
    assert aligned.min() > 1 - 1e-6


def test_a_finely_divided_sphere_is_left_alone() -> None:
    ball = trimesh.creation.icosphere(3)
    vertices, faces = np.array(ball.vertices), np.array(ball.faces, np.int32)
    origin, split = split_creases(vertices, faces)
    assert np.array_equal(np.sort(origin), np.arange(len(vertices)))
    assert np.array_equal(vertices[origin][split], vertices[faces])


def test_a_cylinder_is_split_only_along_its_two_rims() -> None:
    cylinder = trimesh.creation.cylinder(radius=1, height=2, sections=32)
    origin, _ = split_creases(np.array(cylinder.vertices), np.array(cylinder.faces, np.int32))
    assert len(origin) == len(cylinder.vertices) + 2 * 32


def test_a_mesh_without_faces_stays_as_it_is() -> None:
    origin, split = split_creases(np.zeros((2, 3)), np.zeros((0, 3), np.int32))
    assert list(origin) == [0, 1] and split.shape == (0, 3)
