"""`mvtn render-views`: from files to pictures, and from the files of cameras back to the same pictures."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from demonstration import Demo
from PIL import Image
from processes import REPOSITORY, Ended, Folder, finish
from typer.testing import CliRunner

from mvtn_cli.app import app

Render = Callable[..., Ended]


@pytest.fixture
def render(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Render:
    """Run `mvtn render-views WORDS...` in this process, which has torch in memory, in an empty folder."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    for name in [name for name in os.environ if name.startswith("MVTN_") and name != "MVTN_CACHE"]:
        monkeypatch.delenv(name)

    def run(*words: object, stdin: bytes = b"") -> Ended:
        result = CliRunner().invoke(app, ["render-views", *map(str, words), "-j", "1"], input=stdin)
        return Ended(result.exit_code, result.stdout, result.stderr)

    return run


def write_cone(path: Path, height: float = 1.0) -> Path:
    """A cone along z, neither in the origin nor of size 1."""
    cone = trimesh.creation.cone(radius=3, height=height, sections=12)
    path.parent.mkdir(parents=True, exist_ok=True)
    cone.apply_translation([10, 20, 30])
    path.write_text(trimesh.exchange.off.export_off(cone, digits=10))
    return path


def write_cloud(path: Path) -> Path:
    np.savetxt(path, np.random.default_rng(0).normal(size=(400, 3)) * [1, 2, 0.5])
    return path


def pixels(path: str | Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image)


# Files of cameras


@pytest.mark.parametrize(
    "words",
    [
        ["--views", "random", "--num-views", 5, "--seed", 3, "--fov", "47.123456789", "--distance", "1.9"],
        ["--azimuth", "0,180,270,359.99,-0.0,123.4", "--elevation", "0,-90,90,100,-170,33.3", "--shading", "flat"],
        ["--layout", "dodecahedral", "--look", "paper"],
    ],
    ids=["random", "given", "layout"],
)
@pytest.mark.parametrize("supersample", [1, 2])
@pytest.mark.parametrize("kind", ["mesh", "points"])
def test_transforms_json_draws_the_same_pictures_again(
    kind: str, supersample: int, words: list[object], render: Render
):
    write_cone(Path("a cone.off"), 4)
    own = ("--render", kind, "--supersample", supersample, "--image-size", 40, "--point-radius", "0.03")
    if kind == "points":
        own = (*own, "--depth-cue", "0.5")
    drawn = render("a cone.off", *words, *own, "--cameras", "--outputs", "depth,arrays", "-o", "one")
    again = render("a cone.off", "--cameras-from", "one/a-cone/transforms.json", "--cameras", "-o", "two", "--json")
    assert drawn.code == again.code == 0, drawn.err + again.err
    frames = json.loads(Path("one/a-cone/transforms.json").read_text())["frames"]
    (answer,) = again.document["pictures"]
    assert len(frames) == len(answer["views"]) >= 5
    for frame, view in zip(frames, answer["views"], strict=True):
        first = Path("one/a-cone") / frame["file_path"]
        assert pixels(first).std() > 5 and first.read_bytes() == Path(view["picture"]).read_bytes()
        assert (Path("one/a-cone") / frame["depth_file_path"]).is_file()
    assert Path("one/a-cone/cameras.png").read_bytes() == Path("two/a-cone/cameras.png").read_bytes()
    assert "depth" not in answer["views"][0]


def page() -> dict[str, Any]:
    """The functions that docs/cameras.md defines."""
    names: dict[str, Any] = {"np": np}
    text = (REPOSITORY / "docs" / "cameras.md").read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(block, names)
    return names


def test_depth_and_cameras_lead_back_to_the_surface_in_the_units_of_the_file(render: Render):
    """With the code on docs/cameras.md: from pixel and depth to the world, and to the file."""
    path = write_cone(Path("cone.off"), 5)
    drawn = render(path, "--up", "z", "--outputs", "depth", "--cameras", "--image-size", 64, "--layout", "icosahedral")
    assert drawn.code == 0, drawn.err
    document, found, told = json.loads(Path("views/cone/cameras.json").read_text()), [], page()
    lens = [document["intrinsics"][name] for name in ("focal", "cx", "cy")]
    for view in document["views"]:
        steps = pixels(Path("views/cone") / view["depth"])
        row, column = np.nonzero(steps)
        rotation, shift = np.array(view["world_to_camera"])[:, :3], np.array(view["world_to_camera"])[:, 3]
        depth = steps[row, column] / document["depth_steps_per_radius"]
        world = told["to_world"](row, column, depth, rotation, shift, *lens)
        found.append(told["to_file"](world, document["center"], document["radius"], z_up=True))
    points = np.concatenate(found)
    assert len(points) > 5000 and points.min(axis=0) == pytest.approx(trimesh.load(path).bounds[0], abs=0.15)
    # A cone with 12 sides: within its outer circle, on its slope or on its floor.
    height, radius = points[:, 2] - 30, np.linalg.norm(points[:, :2] - [10, 20], axis=1)
    slope = 3 * (1 - height / 5)
    on_floor = np.abs(height) < 0.002
    on_slope = (radius < slope + 0.002) & (radius > slope * np.cos(np.pi / 12) - 0.002)
    assert (on_floor | on_slope).all() and on_floor.sum() > 500 and on_slope.sum() > 1000


def test_cameras_that_cannot_be_used_are_refused_before_anything_is_drawn(render: Render):
    write_cone(Path("a.off"))
    for words, told in (
        (["--cameras-from", "gone.json"], "gone.json can't be read: No such file"),
        (["--cameras-from", "a.off"], "a.off is not JSON"),
        (["--cameras-from", "gone.json", "--azimuth", "3"], "--cameras-from names the cameras already"),
    ):
        message, hint = render("a.off", *words).error
        assert told in message and hint
    assert not Path("views").exists()


# More pictures


def test_point_clouds_have_silhouettes_and_depth_and_no_normals(render: Render):
    write_cone(Path("a.off"))
    write_cloud(Path("b.xyz"))
    drawn = render("a.off", "b.xyz", "--outputs", "silhouette,depth", "--image-size", 32, "--json", "-o", "one")
    assert drawn.code == 0
    for answer in drawn.document["pictures"]:
        for view in answer["views"]:
            mask, depth = pixels(view["silhouette"]), pixels(view["depth"])
            assert set(np.unique(mask)) == {0, 255} and np.array_equal(mask > 0, depth > 0)
            assert depth[depth > 0].min() >= 12_000 and depth.max() <= 32_000 and depth.dtype == np.uint16
    refused = render("a.off", "b.xyz", "--outputs", "normals", "--image-size", 32, "--jsonl", "-o", "two")
    assert refused.code == 1 and [Path(answer["file"]).name for answer in refused.lines] == ["a.off"]
    assert "b.xyz: points have no normals; leave normals out of --outputs" in refused.err
    assert render("a.off", "b.xyz", "--outputs", "normals", "--on-bad", "skip", "-q", "-o", "two").code == 0
    message, _ = render("a.off", "--outputs", "normals", "--render", "points").error
    assert message == "points have no normals to draw"
    message, hint = render("a.off", "--outputs", "depth,normal").error
    assert message == "unknown outputs 'normal'; did you mean 'normals'?" and "silhouette" in hint


def test_a_turntable_is_a_gif(render: Render):
    write_cone(Path("a.off"))
    (answer,) = render("a.off", "--turntable", "--image-size", 32, "--elevation", "-20", "--jsonl").lines
    with Image.open(answer["turntable"]) as image:
        assert image.format == "GIF" and image.size == (32, 32)


def test_a_run_shows_where_its_cameras_stand(demo: Demo, render: Render):
    words = ("--limit", 1, "--cameras", "--outputs", "normals", "--image-size", 24)
    drawn = render(demo.run, *words, "--cache", demo.folder.cache, "--json")
    assert drawn.code == 0, drawn.err
    (answer,) = drawn.document["pictures"]
    with Image.open(answer["cameras_picture"]) as image:
        assert image.size == (720, 720)
    assert [pixels(view["normals"]).shape for view in answer["views"]] == [(24, 24, 3)] * 2


@pytest.mark.parametrize("kind", ["mesh", "points"])
def test_the_cameras_of_a_run_draw_the_same_pictures_again(kind: str, demo: Demo, render: Render):
    words = ("builtin:shapes?train=24&test=12", "--limit", 2, "--cache", demo.folder.cache, "--jsonl")
    own = ("--run", demo.run, "--cameras", "--render", kind, "--supersample", 2, "--image-size", 24)
    drawn = render(*words, *own)
    assert drawn.code == 0, drawn.err
    for shape, answer in enumerate(drawn.lines):
        again = render(*words, "--cameras-from", answer["transforms"], "--per-view", "-o", f"again{shape}")
        assert again.code == 0, again.err
        views = zip(answer["views"], again.lines[shape]["views"], strict=True)
        pictures = [[Path(view["picture"]).read_bytes() for view in pair] for pair in views]
        assert len(pictures) == 2 and all(first == second for first, second in pictures)


# Names, streams, and what may go wrong


def test_files_of_one_name_get_pictures_of_their_own(render: Render):
    paths = [write_cone(Path(name), 1 + n) for n, name in enumerate(("a/chair.off", "b/chair.off", "a-chair.off"))]
    drawn = render(*paths, "--image-size", 24, "--num-views", 2, "--per-view", "--jsonl")
    assert drawn.code == 0
    pictures = [answer["picture"] for answer in drawn.lines]
    assert pictures == ["views/a-chair.png", "views/b-chair.png", "views/a-chair-2.png"]
    views = [Path(answer["views"][0]["picture"]).read_bytes() for answer in drawn.lines]
    assert len(set(views)) == 3  # nothing was written over: each shows its own cone


def test_a_name_does_not_depend_on_which_files_are_drawn_together(render: Render):
    paths = [write_cone(Path(f"{folder}/{n:02d}.off")) for folder in ("a", "b") for n in range(10)]
    drawn = render(*paths, "--image-size", 8, "--num-views", 1, "--jsonl")
    names = [answer["name"] for answer in drawn.lines]
    assert names == [f"{folder}/{n:02d}" for folder in ("a", "b") for n in range(10)]


def test_the_first_pictures_come_before_the_last_file_is_read(folder: Folder):
    for n in range(17):
        write_cone(folder.path / f"{n:02d}.off")
    (folder.path / "17.off").write_text("OFF\n")
    program = 'exec "$0" -m mvtn_cli render-views *.off --image-size 8 --num-views 1 --jsonl 2>&1'
    ended = finish(folder.start("sh", "-c", program, sys.executable))
    told = ended.out.splitlines()
    lines = [json.loads(line) for line in told if line.startswith("{") and '"picture"' in line]
    (bad,) = [number for number, line in enumerate(told) if line.startswith("warning: 17.off")]
    assert ended.code == 1 and len(lines) == 17
    assert '"name": "15"' in told[bad - 1] and '"name": "16"' in told[bad + 1]


def test_a_reader_that_has_enough_ends_it_quietly_and_keeps_what_was_drawn(folder: Folder):
    for n in range(3):
        write_cone(folder.path / f"{n}.off")
    process = folder.start("mvtn", "render-views", "0.off", "1.off", "2.off", "--image-size", 16, "--jsonl")
    assert process.stdin and process.stdout and process.stderr
    process.stdin.close()
    first = json.loads(process.stdout.readline())
    process.stdout.close()  # what `head -1` does
    err = process.stderr.read().decode()
    assert process.wait() in (0, -signal.SIGPIPE) and "error" not in err and "Traceback" not in err
    listed = json.loads((folder.path / "views" / "cameras.json").read_text())["shapes"]
    assert listed[0] == first


def test_ctrl_c_says_what_is_kept(folder: Folder):
    for n in range(2):
        write_cone(folder.path / f"{n}.off")
    process = folder.start("mvtn", "render-views", "0.off", "1.off", "--num-views", 100, "--turntable", "--jsonl")
    assert process.stdout
    json.loads(process.stdout.readline())
    process.send_signal(signal.SIGINT)
    ended = finish(process)
    message, hint = ended.err.split("error: ")[-1].splitlines()[:2]
    assert ended.code == 130 and message.startswith("interrupted; the pictures of 1 shape are in views")
    assert "draws all of them again" in hint and "Traceback" not in ended.err
    assert len(json.loads((folder.path / "views" / "cameras.json").read_text())["shapes"]) == 1


def test_a_full_disk_is_named_with_the_file_and_leaves_no_half_picture(folder: Folder):
    """The disk is full for every file of more than 40 kB: for the sheet, not for the shape or its small pictures."""
    write_cone(folder.path / "a.off")
    words = ("mvtn", "render-views", "a.off", "--look", "relief", "--num-views", 12, "-o", "out", "--image-size")
    assert folder.run(*words, 16).code == 0  # compiles, and stores the shape
    sheet = (folder.path / "out" / "a.png").read_bytes()
    full = folder.start(*words, 400, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000)))
    ended = finish(full)
    message, hint = ended.error
    assert ended.code == 1 and message.startswith("can't write out/a.png: ") and "--out" in hint
    assert (folder.path / "out" / "a.png").read_bytes() == sheet  # the old one, whole
    assert [path.name for path in (folder.path / "out").iterdir() if path.name.startswith(".")] == []


def test_a_file_in_place_of_the_folder_is_named(render: Render):
    write_cone(Path("a.off"))
    Path("taken").write_text("")
    message, hint = render("a.off", "--image-size", 16, "-o", "taken").error
    assert message.startswith("can't write taken/a.png: ") and "--out" in hint


def test_a_file_name_that_is_no_text_is_drawn_and_listed(render: Render):
    name: Any = os.fsdecode(b"caf\xe9.off")
    write_cone(Path("a.off")).rename(name)
    drawn = render("-", "--image-size", 16, "--cameras", "--jsonl", stdin=os.fsencode(name) + b"\n")
    assert drawn.code == 0, drawn.err
    (shape,) = json.loads(Path("views/cameras.json").read_text(encoding="utf-8"))["shapes"]
    assert Path(shape["file"]).name == name and Path(shape["picture"]).is_file()
