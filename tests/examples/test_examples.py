"""Each script in `examples/`, run as its header says, with settings small enough for seconds."""

from __future__ import annotations

import os
import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from processes import REPOSITORY, Ended, Folder, once

EXAMPLES = REPOSITORY / "examples"
CLASSES = ("box", "cone", "cylinder", "egg", "ring")
TINY = {
    "SHAPES": "5",
    "MVTN_EPOCHS": "2",
    "MVTN_IMAGE_SIZE": "16",
    "MVTN_NUM_VIEWS": "2",
    "MVTN_ENCODER_POINTS": "64",
    "MVTN_WORKERS": "1",
    "MVTN_THREADS": "1",
}


@dataclass(frozen=True)
class OwnMeshes:
    """The folder in which `own_meshes.sh` was run, and what it left behind."""

    folder: Folder
    ended: Ended


def run_example(folder: Folder, name: str, *words: object, path: str = "", mvtn: str = "", **settings: str) -> Ended:
    """Run a script in a folder.

    Args:
        folder: Where.
        name: Of the script.
        words: Its arguments.
        path: Where its programs are found; `mvtn` and `python` are those under test.
        mvtn: What stands for `mvtn` instead.
        settings: Variables beside the tiny ones.
    """
    programs = folder.path.parent / "programs"
    programs.mkdir(parents=True, exist_ok=True)
    commands = {"mvtn": mvtn or f'"{sys.executable}" -m mvtn_cli', "python": f'"{sys.executable}"'}
    for program, command in commands.items():
        (programs / program).write_text(f'#!/bin/sh\nexec {command} "$@"\n')
        (programs / program).chmod(0o755)
    variables = {**TINY, "PATH": os.pathsep.join([str(programs), path or os.environ["PATH"]]), **settings}
    starter = "python" if name.endswith(".py") else "bash"
    return folder.run(starter, EXAMPLES / name, *words, variables=variables)


def play_own_meshes(path: Path) -> OwnMeshes:
    folder = Folder(path / "work")
    return OwnMeshes(folder, run_example(folder, "own_meshes.sh"))


@pytest.fixture(scope="module")
def own_meshes(tmp_path_factory: pytest.TempPathFactory) -> OwnMeshes:
    """What the first example leaves behind is what two others begin with."""
    return once(tmp_path_factory, "own_meshes", play_own_meshes)


def test_own_meshes_goes_from_a_folder_of_meshes_to_a_report(own_meshes: OwnMeshes):
    ended = own_meshes.ended
    assert ended.code == 0, ended.err
    assert "CLASS/file, z up: 25 shapes in 5 classes (20 train, 5 test)" in ended.err
    rows = [line.split("\t")[0] for line in ended.out.splitlines()]
    assert [row for row in rows if row in CLASSES] == list(CLASSES) and rows[-1].startswith("baseline: ")
    (report,) = own_meshes.folder.path.glob("runs/*/report.html")
    assert "own_meshes" in report.read_text(encoding="utf-8")


def test_own_meshes_takes_a_folder_of_ones_own(tmp_path: Path):
    folder = Folder(tmp_path / "work")
    ended = run_example(folder, "own_meshes.sh", "my shapes", mvtn="echo")
    assert ended.out.splitlines() == [
        "preprocess folder:my shapes?up=y --on-bad skip",
        "train",
        "eval --baseline",
    ]
    assert list(folder.path.iterdir()) == []


@pytest.mark.parametrize("jq", [False, True] if shutil.which("jq") else [False])
def test_predict_pipe_counts_the_classes_of_a_folder(jq: bool, own_meshes: OwnMeshes, tmp_path: Path):
    tools = tmp_path / "tools"
    tools.mkdir()
    for tool in ("bash", "find", "sort", "uniq", *(["jq"] if jq else [])):
        (tools / tool).symlink_to(str(shutil.which(tool)))
    shutil.copytree(own_meshes.folder.path / "own_meshes", tmp_path / "all sorts")
    (tmp_path / "all sorts" / "ring" / "broken.off").write_text("OFF\n")
    ended = run_example(own_meshes.folder, "predict_pipe.sh", tmp_path / "all sorts", path=str(tools))
    assert ended.code == 0 and "broken.off" in ended.err
    counts = {name: int(count) for count, name in (line.split() for line in ended.out.splitlines())}
    assert sum(counts.values()) == 25 and set(counts) <= set(CLASSES)
    assert list(counts.values()) == sorted(counts.values(), reverse=True)


def test_learned_cameras_prints_and_draws_where_they_stand(own_meshes: OwnMeshes):
    ended = run_example(own_meshes.folder, "learned_cameras.py")
    assert ended.code == 0, ended.err
    rows = re.findall(r"^ *(\d) +(-?[\d.]+) +(-?[\d.]+) +([\d.]+)$", ended.out, re.M)
    assert [row[0] for row in rows] == ["1", "2"]
    assert all(-180 <= float(a) <= 180 and -90 <= float(e) <= 90 and 0 <= float(m) < 90 for _, a, e, m in rows)
    with Image.open(own_meshes.folder.path / "learned_cameras.png") as picture:
        picture.load()
        assert picture.width > 2 * 96 and picture.height > 5 * 96  # a row for each of the five test shapes


def test_depth_to_points_finds_the_surface_of_a_mesh_in_the_units_of_its_file(tmp_path: Path):
    folder = Folder(tmp_path / "work")
    ended = run_example(folder, "depth_to_points.py")
    assert ended.code == 0, ended.err
    (count,) = re.findall(r"^(\d+) points of 12 pictures: depth_to_points\.xyz$", ended.out, re.M)
    points = np.loadtxt(folder.path / "depth_to_points.xyz")
    assert points.shape == (int(count), 3) and len(points) > 500
    # The ring that it makes: circles of radius 15 around a circle of radius 50. In 32 flat pieces it lies up to
    # 65 (1 - cos(180°/32)) inside of that where it is widest, and 35 (1 - cos(180°/32)) outside at its hole.
    to_middle = np.hypot(np.linalg.norm(points[:, :2], axis=1) - 50, points[:, 2])
    assert to_middle.min() > 14.6 and to_middle.max() < 15.18


def test_depth_to_points_takes_a_mesh_of_ones_own(tmp_path: Path):
    folder = Folder(tmp_path / "work")
    folder.path.mkdir(exist_ok=True)
    box = trimesh.creation.box([1, 2, 3])
    box.apply_translation([10, 20, 30])
    box.export(folder.path / "a box.off")
    ended = run_example(folder, "depth_to_points.py", "a box.off", MVTN_IMAGE_SIZE="64")
    assert ended.code == 0, ended.err
    rows = re.findall(r"^(?:the file|points) +from \[(.+)\] to \[(.+)\]$", ended.out, re.M)
    file, points = (np.array([corner.split() for corner in row], dtype=float) for row in rows)
    assert file.tolist() == [[9.5, 19, 28.5], [10.5, 21, 31.5]]
    assert np.abs(points - file).max() < 0.1


def test_compare_views_prints_means_and_intervals_of_three_selections(tmp_path: Path):
    folder = Folder(tmp_path / "work")
    ended = run_example(folder, "compare_views.sh", "builtin:shapes?train=24&test=12", MVTN_EPOCHS="1")
    assert ended.code == 0, ended.err
    rows = [line.split("\t") for line in ended.out.splitlines()]
    selections = ["fixed", "jittered", "learned-spherical"]
    assert [row[0] for row in rows[:4]] == ["views", *selections]
    assert [row[0] for row in rows[4:]] == [
        "difference",
        *(f"{b} - {a}" for a, b in (selections[:2], selections[::2], selections[1:])),
    ]
    for _, mean, low, high in rows[5:]:
        assert float(low) <= float(mean) <= float(high)
    assert len(list(folder.path.glob("runs/*/*/best.safetensors"))) == 9


def test_every_example_is_run_here_and_says_what_one_learns_and_how_long_it_takes():
    others = REPOSITORY / "tests/export/test_export_command.py"  # which has a run and its export at hand
    tests = "".join(path.read_text(encoding="utf-8") for path in (Path(__file__), others))
    scripts = [path for path in EXAMPLES.iterdir() if path.suffix in (".sh", ".py")]
    assert len(scripts) >= 4
    for script in scripts:
        head = script.read_text(encoding="utf-8")[:1200]
        assert f'"{script.name}"' in tests, f"no test runs {script.name}"
        assert "You learn  " in head and "Time       " in head and "Use        " in head
        assert script.suffix == ".py" or os.access(script, os.X_OK)
