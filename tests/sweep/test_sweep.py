"""`mvtn sweep`: which trainings it means, and the real thing on eight boxes."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.commands.settings import resolve
from mvtn_cli.commands.sweep import plan_of, settings_of
from mvtn_cli.config import SweepConfig, TrainConfig
from mvtn_cli.core.training import batch_size
from mvtn_cli.core.training import sweep as sweep_module
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.training.sweep_plot import draw_plots
from mvtn_cli.errors import Interrupted, UsageError

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
TINY = (
    *("--image-size", "16", "--encoder-points", "16", "--epochs", "1", "--batch-size", "4", "--num-views", "2"),
    *("--val-fraction", "0", "--device", "cpu", "--threads", "1", "--workers", "1"),
)


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    return tmp_path


@pytest.fixture
def boxes(own_folder: Path) -> str:
    """Two classes of boxes, three to train on and two to test with each."""
    for kind, extents in (("cube", (1, 1, 1)), ("plate", (1, 0.2, 1))):
        for number in range(5):
            split = "train" if number < 3 else "test"
            path = own_folder / "boxes" / kind / split / f"{kind}_{number}.off"
            path.parent.mkdir(parents=True, exist_ok=True)
            vertices = CORNERS * extents * (1 + 0.05 * np.array([number, 0, -number]))
            lines = [" ".join(f"{value:.6f}" for value in vertex) for vertex in vertices]
            path.write_text("\n".join(["OFF", "8 6 0", *lines, *("4 " + " ".join(map(str, side)) for side in SIDES)]))
    return "folder:boxes"


def mvtn(*words: object) -> Any:
    return CliRunner().invoke(app, ["sweep", *map(str, words)])


def plan(*vary: str, **options: Any) -> dict[str, TrainConfig]:
    config, _ = resolve(SweepConfig, {"vary": list(vary), **options}, None, "sweep")
    return plan_of(config)


def refused(*vary: str, **options: Any) -> str:
    with pytest.raises(UsageError) as caught:
        plan(*vary, **options)
    return caught.value.message


# What is trained


def test_a_grid_has_all_combinations_and_keeps_all_other_settings():
    found = plan("num-views=1,3", "views=fixed,learned", epochs="7")
    assert list(found) == [f"num-views-{n}+views-{views}" for n in (1, 3) for views in ("fixed", "learned")]
    assert [(one.num_views, one.views, one.epochs) for one in found.values()] == [
        *((1, "fixed", 7), (1, "learned-spherical", 7), (3, "fixed", 7), (3, "learned-spherical", 7))
    ]


def test_one_at_a_time_has_the_plain_settings_once():
    found = plan("num-views=1,6", "image-size=32,64,128", one_at_a_time=True)
    assert {word: (one.num_views, one.image_size) for word, one in found.items()} == {
        "plain": (6, 64), "num-views-1": (1, 64), "image-size-32": (6, 32), "image-size-128": (6, 128),
    }  # fmt: skip


def test_what_comes_to_the_same_comes_once():
    assert len(plan("views=learned,learned-spherical,fixed", "layout=spherical")) == 2
    assert list(plan("lr=0.001,1e-3")) == ["lr-0.001"]
    words = list(plan("weights=a/b.pth,a-b.pth", backbone="resnet18"))
    assert words == ["weights-a-b.pth", "weights-a-b.pth-2"]


def test_what_hangs_on_a_varied_setting_follows_it():
    found = plan("layout=dodecahedral,spherical", views="fixed", num_views="7")
    assert [one.num_views for one in found.values()] == [20, 7]
    direct = plan("views=fixed,learned-direct", preset="modelnet40-mvtn-direct-mvcnn-12")
    assert [one.angles for one in direct.values()] == ["periodic", "tanh"]
    stages = plan("epochs=17,85", preset="modelnet40-mvtn-viewgcn-12")
    assert [one.first_stage_epochs for one in stages.values()] == [10, 50]
    config, _ = resolve(SweepConfig, {"vary": ["lr=1"], "preset": "modelnet40-dgcnn"}, None, "sweep")
    assert settings_of(config, {"lr": "0.5"}).network == "dgcnn"


def test_wrong_wishes_are_refused_with_the_nearest_right_one():
    assert "there is nothing to vary" in refused()
    assert refused("num-views") == "--vary num-views names no setting and values"
    assert "did you mean 'num-views'" in refused("num-view=3")
    assert refused("num-views=3,none") == "--vary num-views must be a whole number, got 'none'"
    assert "did you mean 'jittered'" in refused("views=jitered")
    assert "seeds are not varied" in refused("seed=1,2")
    assert "unknown setting to vary" in refused("runs=a,b")
    assert refused("layout=spherical,icosahedral", "num-views=6").startswith("layout=icosahedral, num-views=6: the ico")


def test_settings_may_stand_in_a_file():
    Path("mvtn.toml").write_text("[sweep]\nvary = ['num-views=1,2', 'views=fixed']\nseeds = 4\n")
    config, origins = resolve(SweepConfig, {}, None, "sweep")
    assert (len(plan_of(config)), config.seeds, origins["vary"]) == (2, 4, "mvtn.toml [sweep]")


def test_a_batch_size_that_is_not_known_yet_is_the_default_until_then():
    assert {one.batch_size for one in plan("views=fixed,random", batch_size="auto").values()} == {32}
    assert [one.batch_size for one in plan("batch-size=4,8", batch_size="auto").values()] == [4, 8]


def test_plain_settings_beside_a_varied_batch_size_get_what_fits(
    boxes: str, own_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    asked: list[TrainConfig] = []
    monkeypatch.setattr(batch_size, "common_batch_size", lambda configs, *_: asked.extend(configs) or 3)
    words = ("--vary", "batch-size=2,4", "--one-at-a-time", "--batch-size", "auto")
    done = mvtn(boxes, *TINY, *words, "--json")
    assert done.exit_code == 0, done.stderr
    assert [cell["settings"]["batch_size"] for cell in json.loads(done.stdout)["cells"]] == [3, 2, 4]
    assert len(asked) == 3


def test_a_dry_run_prints_the_combinations_and_writes_nothing(own_folder: Path):
    result = mvtn("--vary", "num-views=1,2", "--seeds", 3, "--dry-run")
    assert result.exit_code == 0 and result.stdout.splitlines() == [
        *("word\tnum_views", "num-views-1\t1", "num-views-2\t2")
    ]
    assert "6 trainings" in result.stderr and not list(own_folder.iterdir())


# The real thing


def test_a_sweep_trains_measures_and_goes_on(boxes: str, own_folder: Path):
    words = (boxes, *TINY, "--vary", "views=fixed,jittered", "--seeds", 2)
    first = mvtn(*words, "--json")
    assert first.exit_code == 0, first.stderr
    document = json.loads(first.stdout)
    folder = own_folder / document["path"]
    assert document["name"] == "sweep-boxes-views" and document["seeds"] == [0, 1]
    assert [cell["settings"] for cell in document["cells"]] == [{"views": "fixed"}, {"views": "jittered"}]
    for cell in document["cells"]:
        runs = [Run.open(run["run"]) for run in cell["runs"]]
        assert all(run.finished for run in runs) and [run.config.seed for run in runs] == [0, 1]
        assert {run.config.views for run in runs} == {cell["settings"]["views"]}
        values = [run["accuracy"] for run in cell["runs"]]
        assert set(values) <= {0, 0.25, 0.5, 0.75, 1}
        assert cell["accuracy"]["mean"] == pytest.approx(np.mean(values))
        assert cell["accuracy"]["sd"] == pytest.approx(np.std(values, ddof=1))
        assert cell["seconds"]["mean"] == pytest.approx(np.mean([run.info["seconds"] for run in runs]))
    rows = list(csv.DictReader((folder / "sweep.csv").open()))
    assert [(row["views"], row["seed"]) for row in rows] == [
        *(("fixed", "0"), ("fixed", "1"), ("jittered", "0"), ("jittered", "1"))
    ]
    assert "jittered" in (folder / "sweep.svg").read_text() and (folder / "sweep.png").stat().st_size > 1000
    assert json.loads((folder / "sweep.json").read_text())["cells"] == document["cells"]

    # with one more value: what is there stays as it is, and is not even measured again
    stamps = {path: path.stat().st_mtime_ns for path in folder.glob("*/run.json")}
    marked = json.loads((folder / "sweep.json").read_text())
    marked["cells"][0]["runs"][0]["accuracy"] = 0.125
    (folder / "sweep.json").write_text(json.dumps(marked))
    second = mvtn(*words[:-3], "views=fixed,jittered,random", "--seeds", 2)
    assert second.exit_code == 0, second.stderr
    assert stamps == {path: path.stat().st_mtime_ns for path in stamps}
    assert len(list(folder.glob("*/run.json"))) == 6
    header, fixed, *others = second.stdout.splitlines()
    assert header == "views\taccuracy %\tsd\tclass accuracy %\tseconds\truns"
    other = marked["cells"][0]["runs"][1]["accuracy"]
    assert fixed.split("\t")[:2] == ["fixed", f"{100 * (0.125 + other) / 2:.1f}"]
    assert [line.split("\t")[0] for line in others] == ["jittered", "random"]

    # other settings begin a sweep of their own
    third = mvtn(*words[:-1], 1, "--lr", 0.1, "--batch-size", "auto", "--json")
    document = json.loads(third.stdout)
    assert document["name"] == "sweep-boxes-views-2"
    assert [Run.open(cell["runs"][0]["run"]).config.batch_size for cell in document["cells"]] == [32, 32]


def test_a_broken_table_is_measured_again(boxes: str, own_folder: Path):
    words = (boxes, *TINY, "--vary", "views=fixed", "--name", "mine", "--json")
    first = json.loads(mvtn(*words).stdout)
    (own_folder / "runs/mine/sweep.json").write_text("[]")
    second = json.loads(mvtn(*words).stdout)
    assert second["cells"] == first["cells"] and second["cells"][0]["accuracy"]["sd"] is None


def test_a_sweep_that_was_stopped_has_its_table_so_far_and_goes_on(
    boxes: str, own_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    words = (boxes, *TINY, "--vary", "views=fixed,random", "--name", "mine")
    calls, measure = [], sweep_module.predict_test

    def stop_at_the_second(*arguments: Any) -> Any:
        calls.append(arguments[0].name)
        if len(calls) == 2:
            raise Interrupted("stopped")
        return measure(*arguments)

    monkeypatch.setattr(sweep_module, "predict_test", stop_at_the_second)
    assert mvtn(*words).exit_code == 130
    (cell,) = json.loads((own_folder / "runs/mine/sweep.json").read_text())["cells"]
    assert cell["settings"] == {"views": "fixed"}
    again = mvtn(*words, "--json")
    assert again.exit_code == 0 and len(json.loads(again.stdout)["cells"]) == 2
    assert calls == ["views-fixed-s0", "views-random-s0", "views-random-s0"]  # the first one was known


def test_without_test_shapes_it_says_so_before_it_trains(boxes: str, own_folder: Path):
    for path in (own_folder / "boxes").glob("*/test/*"):
        path.unlink()
    result = mvtn(boxes, *TINY, "--vary", "views=fixed")
    assert result.exit_code == 1 and "no shapes for split 'test'" in result.stderr
    assert not (own_folder / "runs").exists()


def test_the_same_numbers_give_the_same_plot(tmp_path: Path):
    cells = [
        {
            "word": f"num-views-{n}",
            "settings": {"num_views": n},
            "accuracy": {"mean": 0.1 * n, "sd": None},
            "seconds": {"mean": 10.0 * n, "sd": 1.0},
        }
        for n in (1, 3, 6)
    ]
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        draw_plots(tmp_path / name, cells, ["num_views"], "boxes")
    a, b = ((tmp_path / name / "sweep.svg").read_bytes() for name in "ab")
    assert a == b and all(f"num-views-{n}".encode() in a for n in (1, 3, 6))
