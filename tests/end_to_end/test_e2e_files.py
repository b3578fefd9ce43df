"""Single files: classes from a pipe, and pictures of them."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
import trimesh
from demonstration import Demo
from numpy.typing import NDArray
from PIL import Image
from processes import Folder

NAMES = ["a cone.off", "näher & weiter/'b' cone.off", "-c.off", "two\nlines.off"]


def write_cones(folder: Folder, *, up: str) -> bytes:
    """Write cones that point along an axis, each of another height, and a broken one; return their names."""
    for number, name in enumerate(NAMES):
        cone = trimesh.creation.cone(radius=1, height=1 + number)
        if up == "y":
            cone.vertices = cone.vertices[:, [0, 2, 1]] * [1, 1, -1]
        path = folder.path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(trimesh.exchange.off.export_off(cone, digits=10))
    (folder.path / "bad one.off").write_text("OFF\n3 1 0\n0 0 0\n")
    return "\0".join([NAMES[0], "bad one.off", *NAMES[1:]]).encode() + b"\0"


def picture(path: Path) -> NDArray[np.uint8]:
    """Decode a picture: (H, W, 3)."""
    with Image.open(path) as image:
        image.load()
        return np.array(image.convert("RGB"))


def test_predict_answers_for_all_names_on_stdin_but_the_bad_one_and_knows_the_up_axis(folder: Folder, demo: Demo):
    upright = folder.mvtn("predict", "-", "--run", demo.run, "--jsonl", stdin=write_cones(folder, up="y"))
    assert upright.code == 1 and [answer["file"] for answer in upright.lines] == NAMES
    assert all(0 < answer["probability"] <= 1 for answer in upright.lines)
    assert "warning: bad one.off: unreadable: line 1: the header declares 3 vertices" in upright.err
    assert "1 of 5 files can't be used" in upright.err

    names = write_cones(folder, up="z")
    lying, fallen = (
        folder.mvtn("predict", "-", "--run", demo.run, *up, "--on-bad", "skip", "--json", stdin=names)
        for up in (("--up", "z"), ())
    )
    assert lying.code == 0 and lying.document["bad"] == 1
    assert [(answer["file"], answer["class"]) for answer in lying.document["predictions"]] == [
        (answer["file"], answer["class"]) for answer in upright.lines
    ]
    # each file's points are drawn by themselves, and move its cameras a little
    assert furthest(lying.document["predictions"], upright.lines) < 0.02
    assert furthest(fallen.document["predictions"], upright.lines) > 0.05


def furthest(answers: list[dict], others: list[dict]) -> float:
    """The largest difference of two lists of probabilities."""
    return max(abs(one["probability"] - other["probability"]) for one, other in zip(answers, others, strict=True))


def test_predict_falls_silent_when_its_reader_has_enough(folder: Folder, demo: Demo):
    names = write_cones(folder, up="y")
    process = folder.start("mvtn", "predict", "-", "--run", demo.run, "--batch-size", 1, "--on-bad", "skip")
    assert process.stdin and process.stdout and process.stderr
    process.stdin.write(names)
    process.stdin.close()
    first = process.stdout.readline()
    process.stdout.close()  # what `head -1` does
    err = process.stderr.read().decode()
    assert first.decode().split("\t")[0] == NAMES[0]
    assert process.wait() in (0, -signal.SIGPIPE) and "error" not in err and "Traceback" not in err


def test_a_coloured_mesh_is_drawn_in_its_colours_from_the_angles_asked_for(folder: Folder):
    box = trimesh.creation.box()
    box.visual.vertex_colors = np.where(box.vertices[:, :1] > 0, [[0, 0, 255, 255]], [[255, 0, 0, 255]])
    box.export(folder.path / "red and blue.ply")
    drawn = folder.mvtn(
        *("render-views", "red and blue.ply", "--azimuth", "90,-90,0", "--elevation", "0,0,20"),
        *("--image-size", 24, "--per-view", "--out", "pictures", "--json"),
    )
    assert drawn.code == 0
    (answer,) = drawn.document["pictures"]
    assert [(view["azimuth_deg"], view["elevation_deg"]) for view in answer["views"]] == [(90, 0), (-90, 0), (0, 20)]
    assert picture(folder.path / answer["picture"]).shape[1] >= 3 * 24
    blue, red, both = (picture(folder.path / view["picture"]).astype(int) for view in answer["views"])
    assert blue.shape == red.shape == both.shape == (24, 24, 3)
    assert blue.max(axis=(0, 1)).tolist() == [0, 0, 255]  # from +X only the blue side is seen
    assert red.max(axis=(0, 1)).tolist() == [255, 0, 0]
    row = both[12]  # from the front: red on the left, blue on the right
    assert row[8, 0] > row[8, 2] and row[15, 2] > row[15, 0]


def test_a_run_draws_what_its_cameras_see(folder: Folder, demo: Demo):
    drawn = folder.mvtn(
        *("render-views", demo.run, "--limit", 2, "--image-size", 20, "--per-view", "--json"), MVTN_OUT="seen"
    )
    assert drawn.code == 0 and drawn.document["run"] == str(demo.run)
    answers = drawn.document["pictures"]
    assert len(answers) == 2 and len({answer["label"] for answer in answers}) == 2
    views = [view for answer in answers for view in answer["views"]]
    images = [picture(folder.path / view["picture"]) for view in views]
    assert [image.shape for image in images] == [(20, 20, 3)] * 4
    assert min(image.std() for image in images) > 10  # something is seen
    with (demo.run / "views.csv").open() as file:
        told = [line.split(",") for line in file.read().splitlines()[1:]]
    angles = {(name, int(view)): (float(a), float(e)) for name, _, view, a, e, *_ in told}
    for answer in answers:
        for number, view in enumerate(answer["views"]):
            azimuth, elevation = angles[answer["name"], number]
            apart = (view["azimuth_deg"] - azimuth + 180) % 360 - 180, view["elevation_deg"] - elevation
            assert apart == pytest.approx((0, 0), abs=0.01)
