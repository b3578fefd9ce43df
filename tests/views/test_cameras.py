"""Cameras: T1..T4 of the stiff cases, and the algebra that the renderer relies on."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from mvtn_cli.core.views import Cameras, angle_between, camera_jacobian, camera_positions, camera_rotations

angles = st.floats(-720, 720, allow_nan=False)


def look_at(position: np.ndarray) -> np.ndarray:
    """The usual construction, for comparison: cross products with the up vector (0, 1, 0)."""
    backward = position / np.linalg.norm(position)
    right = np.cross([0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(backward, right), backward])


def real(number: float) -> torch.Tensor:
    return torch.tensor(number, dtype=torch.float64)


def rotation(azimuth: float, elevation: float) -> np.ndarray:
    return camera_rotations(real(azimuth), real(elevation)).numpy()


@pytest.mark.parametrize(
    ("azimuth", "elevation", "expected"), [(0, 0, (0, 0, 1)), (90, 0, (1, 0, 0)), (37, 90, (0, 1, 0))]
)
def test_azimuth_0_is_plus_z_and_90_is_plus_x_and_elevation_90_is_plus_y(azimuth, elevation, expected):
    camera = Cameras.at([azimuth], [elevation], 2.5)
    np.testing.assert_allclose(camera.positions[0, 0], 2.5 * np.array(expected), atol=1e-6)


@given(angles, angles)
def test_axes_are_a_right_handed_orthonormal_frame_everywhere(azimuth, elevation):
    frame = rotation(azimuth, elevation)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1, abs=1e-12)


@given(angles, st.floats(-89, 89))
def test_closed_form_equals_look_at_away_from_the_poles(azimuth, elevation):
    position = camera_positions(real(azimuth), real(elevation), 2.2).numpy()
    np.testing.assert_allclose(rotation(azimuth, elevation), look_at(position), atol=1e-12)


@given(angles, angles, st.floats(0.01, 1e4))
def test_the_origin_lies_straight_ahead_and_the_camera_at_its_own_zero(azimuth, elevation, distance):
    camera = Cameras.at([azimuth], [elevation], distance)
    rt = camera.rt[0, 0].double()
    assert rt[:, 3].tolist() == pytest.approx([0, 0, -distance])
    own = rt[:, :3] @ camera.positions[0, 0].double() + rt[:, 3]
    assert float(own.norm()) <= 1e-6 * distance


@given(angles, angles)
@settings(deadline=None)
def test_jacobian_and_autograd_equal_central_differences(azimuth, elevation):
    step = 1e-4
    point = torch.tensor([azimuth, elevation], dtype=torch.float64)

    def matrix(x: torch.Tensor) -> torch.Tensor:
        return camera_rotations(x[0], x[1])

    by_azimuth, by_elevation = camera_jacobian(point[0], point[1])
    auto = torch.autograd.functional.jacobian(matrix, point)
    for axis, exact in enumerate((by_azimuth, by_elevation)):
        shift = step * torch.eye(2, dtype=torch.float64)[axis]
        difference = (matrix(point + shift) - matrix(point - shift)) / (2 * step)
        # per degree; 1e-7 of a radian's change is 1.7e-9 of a degree's
        torch.testing.assert_close(exact, difference, atol=1.7e-9, rtol=0)
        torch.testing.assert_close(auto[..., axis], exact, atol=1e-14, rtol=0)


def test_gradient_of_rt_reaches_all_three_numbers():
    fields = [torch.tensor([[x]], requires_grad=True) for x in (200.0, 95.0, 2.2)]
    weight = torch.linspace(-1, 1, 12).reshape(3, 4)
    (Cameras(*fields).rt[0, 0] * weight).sum().backward()
    by_azimuth, by_elevation = camera_jacobian(torch.tensor(200.0), torch.tensor(95.0))
    assert float(fields[0].grad) == pytest.approx(float((by_azimuth * weight[:, :3]).sum()), rel=1e-6)
    assert float(fields[1].grad) == pytest.approx(float((by_elevation * weight[:, :3]).sum()), rel=1e-6)
    assert float(fields[2].grad) == pytest.approx(-float(weight[2, 3]))


@pytest.mark.parametrize("seam", [0.0, 180.0, 360.0])
def test_t1_nothing_jumps_where_the_azimuth_wraps(seam):
    near = [rotation(seam + shift, 20.0) for shift in (-0.001, 0.0, 0.001)]
    for one, other in itertools.pairwise(near):
        assert np.abs(one - other).max() < 2e-5
    assert np.abs(rotation(359.999, 20.0) - rotation(-0.001, 20.0)).max() < 1e-12
    one, other = (camera_jacobian(real(seam + s), real(20.0))[0] for s in (-1e-3, 1e-3))
    assert float((one - other).abs().max()) < 1e-6
    assert angle_between(seam - 0.001, 0, seam + 0.001, 0) == pytest.approx(0.002)


@pytest.mark.parametrize("pole", [-90.0, 90.0, 270.0])
def test_t2_nothing_jumps_at_the_poles(pole):
    shifts = np.linspace(-1, 1, 201)
    frames = np.stack([rotation(40.0, pole + s) for s in shifts])
    assert np.abs(np.diff(frames, axis=0)).max() < np.deg2rad(0.0101)
    elevation = torch.tensor([[pole]], requires_grad=True)
    azimuth = torch.tensor([[40.0]], requires_grad=True)
    Cameras(azimuth, elevation, torch.tensor([[2.2]])).rt.square().mul(torch.rand(3, 4)).sum().backward()
    assert torch.isfinite(elevation.grad).all() and torch.isfinite(azimuth.grad).all()


def test_beyond_the_pole_the_camera_stands_opposite_with_its_head_down():
    beyond, opposite = rotation(10.0, 100.0), rotation(190.0, 80.0)
    np.testing.assert_allclose(beyond[2], opposite[2], atol=1e-12)
    np.testing.assert_allclose(beyond[:2], -opposite[:2], atol=1e-12)


@pytest.mark.parametrize("distance", [1e-6, 0.5, 1e4])
def test_t4_distance_scales_the_position_alone(distance):
    near, far = Cameras.at([30.0], [40.0], 1.0), Cameras.at([30.0], [40.0], distance)
    torch.testing.assert_close(near.rt[..., :3], far.rt[..., :3], atol=0, rtol=0)
    torch.testing.assert_close(near.positions * distance, far.positions, rtol=1e-6, atol=0)


def test_large_angles_keep_their_accuracy_in_rt():
    """float32 sines of an azimuth of 36,000 turns would be off by 1e-3; inside it is float64."""
    turned = Cameras.at([30.0 + 360.0 * 100], [20.0]).rt
    torch.testing.assert_close(turned, Cameras.at([30.0], [20.0]).rt, atol=1e-7, rtol=0)


def test_t25_cameras_stay_exact_under_autocast():
    plain = Cameras.at([30.0], [20.0]).rt
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert torch.equal(Cameras.at([30.0], [20.0]).rt, plain)
    assert plain.dtype == torch.float32


def test_at_repeats_one_row_of_angles_for_the_whole_batch_and_select_takes_parts():
    cameras = Cameras.at(np.array([0.0, 90.0, 180.0]), np.array([10.0, 20.0, 30.0]), 2.0, fov_deg=50, batch=4)
    assert (len(cameras), cameras.num_views, cameras.rt.shape) == (4, 3, (4, 3, 3, 4))
    part = cameras.select([1, 2], slice(1, None))
    assert part.azimuth_deg.tolist() == [[90, 180], [90, 180]] and part.fov_deg == 50
    assert part.elevation_deg.tolist() == [[20, 30], [20, 30]]


def test_detach_cuts_the_graph_and_bad_shapes_are_refused():
    azimuth = torch.zeros(1, 2, requires_grad=True)
    assert not Cameras.at(azimuth, torch.zeros(1, 2)).detach().rt.requires_grad
    with pytest.raises(ValueError, match=r"must all be \(B, M\)"):
        Cameras(torch.zeros(1, 2), torch.zeros(1, 3), torch.zeros(1, 2))
    with pytest.raises(ValueError, match="fov_deg"):
        Cameras.at([0.0], [0.0], fov_deg=180.0)
