"""The primitives from which made shapes are built."""

from __future__ import annotations

import numpy as np
import pytest

from mvtn_cli.core.datasets.builtin import mesh as m
from mvtn_cli.core.datasets.builtin.mesh import Mesh

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]

# What the volume must be, on paper; a regular n-gon of circumradius 1 has the area n/2 sin(2 pi/n).
POLYGON_24 = 12 * np.sin(2 * np.pi / 24)
POLYGON_10 = 5 * np.sin(2 * np.pi / 10)
VOLUMES = {
    "box": (m.box(1, 2, 3), 6.0),
    "board": (m.board(1, 2, 3), 6.0),
    "disc": (m.disc(1, 2), 2 * POLYGON_24),
    "hollow": (m.lathe([(0, 0), (2, 0), (2, 3), (1, 3), (1, 1), (0, 1)]), POLYGON_24 * (12 - 2)),
    "rod": (m.rod((0, 0, 0), (0, 3, 4), 1), 5 * POLYGON_10),
    "square post": (m.post((0, 0, 0), (0, 2, 0), 1, 1), 2.0),
    "leaning post": (m.post((0, 0, 0), (1, 2, 0), 1, 1), 2.0),
    "slab": (m.slab(SQUARE, 2), 2.0),
    "mirrored": (m.board(1, 2, 3).scaled(x=-1), 6.0),
    "turned": (m.board(1, 2, 3).turned("z", 33), 6.0),
}


def volume(mesh: Mesh) -> float:
    """Signed: negative where the faces look inwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def is_closed(mesh: Mesh) -> bool:
    """Each directed edge appears once, and so does its reverse."""
    edges = np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    forward = {tuple(edge) for edge in edges.tolist()}
    return len(forward) == len(edges) and forward == {(b, a) for a, b in forward}


@pytest.mark.parametrize("name", VOLUMES)
def test_primitives_are_closed_and_have_their_volume_on_paper(name: str) -> None:
    mesh, expected = VOLUMES[name]
    assert is_closed(mesh)
    assert volume(mesh) == pytest.approx(expected, rel=1e-12)


def test_round_primitives_are_closed_and_a_little_smaller_than_what_they_stand_for() -> None:
    soft = m.rounded_box(1, 2, 3, 0.2, steps=4)
    assert is_closed(soft)
    assert np.ptp(soft.vertices, axis=0) == pytest.approx([1, 2, 3])
    # A rounded box is the Minkowski sum of a box and a ball: volume by Steiner's formula.
    a, b, c, r = 0.6, 1.6, 2.6, 0.2
    steiner = a * b * c + 2 * r * (a * b + b * c + c * a) + np.pi * r**2 * (a + b + c) + 4 / 3 * np.pi * r**3
    assert 0.98 * steiner < volume(soft) < steiner
    ball = m.ball(1, 2, 3, segments=24)
    assert is_closed(ball)
    assert 0.95 * np.pi < volume(ball) < np.pi
    bent = m.tube(m.curve([(0, 0, 0), (1, 1, 0), (2, 0, 1)], 15), 0.1)
    assert is_closed(bent)
    assert volume(bent) > 0


def test_a_turn_about_y_takes_z_to_x() -> None:
    point = Mesh(np.array([[0.0, 0.0, 1.0]]), np.zeros((0, 3), np.int32))
    assert point.turned("y", 90).vertices[0] == pytest.approx([1, 0, 0], abs=1e-15)


def test_a_curve_passes_through_its_control_points() -> None:
    control = np.array([(0.0, 0.0), (1.0, 2.0), (3.0, 1.0), (4.0, 4.0)])
    assert m.curve(control, 13)[::4] == pytest.approx(control)


def test_a_superellipse_fills_its_box_and_lies_on_its_equation() -> None:
    outline = m.superellipse(4, 2, 6, 32)
    assert np.abs(outline).max(0) == pytest.approx([2, 1])
    assert (np.abs(outline / [2, 1]) ** 6).sum(1) == pytest.approx(np.ones(32))
