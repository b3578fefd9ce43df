"""Cameras as files: what is written is read back to the last bit, and what others write is taken if it fits."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from mvtn_cli.core.reporting.camera_files import (
    as_drawn,
    cameras_document,
    intrinsics,
    read_transforms,
    transforms_document,
    world_to_camera,
)
from mvtn_cli.core.reporting.view_cameras import view_settings
from mvtn_cli.core.views import Cameras, angle_between
from mvtn_cli.errors import DataError
from mvtn_cli.render_views_config import RenderViewsConfig

ANGLE = st.floats(-1000, 1000, width=32)
VIEWS = [{"picture": "view_01.png"}, {"picture": "view_02.png"}]
ABOUT = {"name": "a", "look": "relief", "supersample": 2}


def some_cameras() -> Cameras:
    return as_drawn(Cameras.at([30.0, -100.0], [20.0, 130.0], torch.tensor([[2.2, 3.0]]), fov_deg=47.1))


def written(path: Path, cameras: Cameras, size: int = 32) -> dict[str, Any]:
    document = transforms_document(cameras, size, [{"picture": f"{i}.png"} for i in range(cameras.num_views)], ABOUT)
    path.write_text(json.dumps(document))
    return document


def bits(cameras: Cameras) -> list[bytes]:
    return [number.numpy().tobytes() for number in (cameras.azimuth_deg, cameras.elevation_deg, cameras.distance)]


@given(azimuth=ANGLE, elevation=ANGLE, distance=st.floats(1, 100, width=32), fov=st.floats(1, 150))
def test_any_camera_is_read_back_to_the_last_bit(tmp_path_factory, azimuth, elevation, distance, fov):
    asked = Cameras.at([azimuth], [elevation], distance, fov_deg=fov)
    cameras = as_drawn(asked)
    path = tmp_path_factory.mktemp("cameras") / "transforms.json"
    written(path, cameras)
    read = read_transforms(path)
    assert bits(read.cameras) == bits(cameras) == bits(as_drawn(cameras))
    assert (read.cameras.fov_deg, read.image_size) == (fov, 32)
    # What is drawn is what was asked for, but for the rounding of an angle of up to 1,000 degrees.
    assert angle_between(azimuth, elevation, *(float(x) for x in (cameras.azimuth_deg, cameras.elevation_deg))) < 1e-3


def test_what_is_drawn_lies_within_a_turn_and_is_left_alone_there():
    angles = torch.tensor([[-180.0, 180.0, 179.99998, -0.0, 1e-30, 540.0, -541.5, -1e-9]])
    azimuth = as_drawn(Cameras.at(angles, angles)).azimuth_deg[0].tolist()
    assert azimuth == np.float32([-180, -180, 179.99998, 0, 1e-30, -180, 178.5, -1e-9]).tolist()
    assert math.copysign(1, azimuth[3]) == 1


def test_camera_json_projects_like_the_renderer():
    cameras = some_cameras()
    document = cameras_document(cameras, 64, VIEWS, ABOUT)
    inside = document["intrinsics"]
    for number, view in enumerate(document["views"]):
        matrix = np.array(view["world_to_camera"])
        assert np.allclose(matrix, cameras.rt[0, number], atol=1e-6)
        assert np.allclose(view["position"], cameras.positions[0, number], atol=1e-6)
        x, y, z = matrix[:, :3] @ np.zeros(3) + matrix[:, 3]  # every camera looks at the origin
        assert (inside["cx"] + inside["focal"] * x / -z, inside["cy"] - inside["focal"] * y / -z) == (32, 32)
        assert view["picture"] == VIEWS[number]["picture"] and document["look"] == "relief"
    half = math.atan(inside["height"] / 2 / inside["focal"])
    assert 2 * math.degrees(half) == pytest.approx(47.1)


def test_transforms_have_what_radiance_field_programs_ask_for():
    cameras = some_cameras()
    views = [{**view, "depth": "depth.png"} for view in VIEWS]
    document = transforms_document(cameras, 64, views, ABOUT)
    assert document["fl_x"] == document["fl_y"] == pytest.approx(32 / math.tan(document["camera_angle_x"] / 2))
    assert (document["cx"], document["cy"], document["w"], document["h"]) == (32, 32, 64, 64)
    turn = np.array(document["applied_transform"])
    assert np.array_equal(turn @ [0, 1, 0, 1], [0, 0, 1])  # up in mvtn is up there
    for number, frame in enumerate(document["frames"]):
        matrix = np.array(frame["transform_matrix"])
        assert np.allclose(matrix[:3, 3], turn[:, :3] @ cameras.positions[0, number].double().numpy(), atol=1e-6)
        world_to_camera_z_up = np.linalg.inv(matrix)[:3]
        expected = world_to_camera(cameras)[number]
        assert np.allclose(world_to_camera_z_up[:, :3] @ turn[:, :3], expected[:, :3])
        assert (frame["file_path"], frame["depth_file_path"]) == (views[number]["picture"], "depth.png")


def test_cameras_of_others_are_taken_where_they_fit(tmp_path):
    """As the synthetic scenes of NeRF are: z up, radius 4, five digits, no size, no word about axes."""
    azimuth, elevation, distance = math.radians(25), math.radians(40), 4.0311
    backward = [
        math.cos(elevation) * math.sin(azimuth),
        -math.cos(elevation) * math.cos(azimuth),
        math.sin(elevation),
    ]
    right = [math.cos(azimuth), math.sin(azimuth), 0.0]
    columns = np.stack([right, np.cross(backward, right), backward, np.multiply(distance, backward)], axis=1)
    rows = [*np.round(columns, 5).tolist(), [0, 0, 0, 1]]
    path = tmp_path / "transforms_train.json"
    frames = [{"file_path": "./train/r_0", "rotation": 0.01, "transform_matrix": rows}]
    path.write_text(json.dumps({"camera_angle_x": 0.6911112070083618, "frames": frames}))
    read = read_transforms(path)
    assert read.cameras.azimuth_deg.item() == pytest.approx(25, abs=1e-3)
    assert read.cameras.elevation_deg.item() == pytest.approx(40, abs=1e-3)
    assert read.cameras.distance.item() == pytest.approx(4.0311, abs=1e-4)
    assert read.cameras.fov_deg == pytest.approx(39.5978, abs=1e-4) and read.image_size is None
    path.write_text(json.dumps({"fl_x": 100, "w": 80, "h": 80, "frames": frames}))
    assert read_transforms(path).cameras.fov_deg == pytest.approx(2 * math.degrees(math.atan(0.4)))


def test_a_field_of_view_that_was_changed_by_hand_counts(tmp_path):
    document = written(tmp_path / "t.json", some_cameras())
    document["camera_angle_x"] = 1.0
    (tmp_path / "t.json").write_text(json.dumps(document))
    assert read_transforms(tmp_path / "t.json").cameras.fov_deg == pytest.approx(math.degrees(1))


def test_learned_light_is_read_back_to_the_last_bit(tmp_path):
    light = torch.nn.functional.normalize(torch.randn(2, 3, generator=torch.Generator().manual_seed(0)), dim=-1)
    views = [{**view, "light": towards} for view, towards in zip(VIEWS, light.tolist(), strict=True)]
    document = transforms_document(some_cameras(), 32, views, ABOUT)
    (tmp_path / "t.json").write_text(json.dumps(document))
    assert torch.equal(read_transforms(tmp_path / "t.json").light, light[None])
    place, _ = view_settings(RenderViewsConfig(cameras_from=tmp_path / "t.json"))
    assert torch.equal(place(None, [0, 1, 2], 0).light, light.expand(3, 2, 3))  # type: ignore[arg-type]
    assert [view["light"] for view in cameras_document(some_cameras(), 32, views, ABOUT)["views"]] == light.tolist()


def spoilt(change: str) -> str:
    cameras = as_drawn(Cameras.at([0.0], [0.0], 2.0))
    document = transforms_document(cameras, 32, VIEWS[:1], {})
    frame = document["frames"][0]
    match change:
        case "no json":
            return "{"
        case "a list":
            return "[]"
        case "no frames":
            document["frames"] = []
        case "no matrix":
            del frame["transform_matrix"]
        case "ragged":
            frame["transform_matrix"][1] = [1]
        case "nan":
            frame["transform_matrix"][0][0] = math.nan
        case "mirrored":
            frame["transform_matrix"] = (np.array(frame["transform_matrix"]) * [-1, 1, 1, 1]).tolist()
        case "elsewhere":
            frame["transform_matrix"][0][3] = 0.5
        case "rolled":
            roll = np.array([[0.8, -0.6, 0, 0], [0.6, 0.8, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
            frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ roll).tolist()
        case "wide":
            document["w"] = 64
        case "no fov":
            del document["camera_angle_x"], document["fl_x"]
        case "bad turn":
            document["applied_transform"] = [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0]]
        case "short light":
            document["mvtn"]["light"] = [[0, 0, 0.5]]
        case "too many lights":
            document["mvtn"]["light"] = [[0, 0, 1], [0, 0, 1]]
        case "dark":
            document["mvtn"]["light"] = None
    return json.dumps(document)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("no json", "is not JSON"),
        ("a list", "names no cameras"),
        ("no frames", "names no cameras"),
        ("no matrix", "no rotation and position in the transform_matrix of frame 1"),
        ("ragged", "no rotation and position"),
        ("nan", "no rotation and position"),
        ("mirrored", "no rotation and position"),
        ("elsewhere", "frame 1 that does not look at the origin"),
        ("rolled", "frame 1 that is rolled"),
        ("wide", "64 x 32 pixels, mvtn's are square"),
        ("no fov", "field of view is not known"),
        ("bad turn", "applied_transform that is no rotation"),
        ("short light", "light that is not 1 directions"),
        ("too many lights", "light that is not 1 directions"),
        ("dark", "light that is not 1 directions"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_sentence(change: str, words: str, tmp_path):
    path = tmp_path / "t.json"
    path.write_text(spoilt(change))
    with pytest.raises(DataError, match=words) as caught:
        read_transforms(path)
    assert caught.value.message.startswith(str(path)) and "\n" not in caught.value.message


def test_the_other_files_of_cameras_are_told_apart(tmp_path):
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps(cameras_document(some_cameras(), 32, VIEWS, ABOUT)))
    with pytest.raises(DataError, match=r"cameras\.json is another file of mvtn than a transforms\.json"):
        read_transforms(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DataError, match=r"gone\.json can't be read: No such file"):
        read_transforms(tmp_path / "gone.json")


def test_settings_of_the_file_hold_but_for_what_is_said_otherwise(tmp_path):
    written(tmp_path / "t.json", some_cameras(), size=40)
    _, settings = view_settings(RenderViewsConfig(cameras_from=tmp_path / "t.json"))
    assert (settings.fov, settings.image_size, settings.look, settings.supersample) == (47.1, 40, "relief", 2)
    place, settings = view_settings(
        RenderViewsConfig(cameras_from=tmp_path / "t.json", look="paper", image_size=24, fov=50, distance=5)
    )
    assert (settings.fov, settings.image_size, settings.look, settings.supersample) == (50, 24, "paper", 2)
    cameras = place(None, [0, 1, 2], 0).cameras  # type: ignore[arg-type]
    assert (len(cameras), cameras.num_views, cameras.fov_deg) == (3, 2, 50) and (cameras.distance == 5).all()
    assert torch.equal(cameras.azimuth_deg[2], some_cameras().azimuth_deg[0])


def test_a_setting_of_the_file_outside_the_limits_of_options_is_refused(tmp_path):
    document = written(tmp_path / "t.json", some_cameras())
    document["mvtn"]["look"] = "sepia"
    (tmp_path / "t.json").write_text(json.dumps(document))
    with pytest.raises(DataError, match=r"t\.json has look = sepia: input should be 'studio'"):
        view_settings(RenderViewsConfig(cameras_from=tmp_path / "t.json"))


def test_the_principal_point_is_the_middle_of_the_picture():
    assert intrinsics(some_cameras(), 33)["cx"] == 16.5
