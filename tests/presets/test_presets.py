"""Presets: each is a valid training whose networks can be built, and gives way to everything that is said."""

from __future__ import annotations

import csv
import io
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.commands.settings import resolve
from mvtn_cli.config import TrainConfig, TrainOptions
from mvtn_cli.core.networks import build_recogniser
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import UsageError
from mvtn_cli.presets import PRESETS, find_preset, settings_beside

CLASSES = {"modelnet40": 40, "shapenet55": 55, "scanobjectnn": 15}
NETWORK_FIELDS = (
    *("network", "backbone", "views", "layout", "num_views", "encoder", "tnets", "regressor", "fuse", "pool"),
    *("first_stage_epochs", "learn_distance", "angles", "encoder_points"),
)
DIRECT, GCN = "modelnet40-mvtn-direct-mvcnn-12", "modelnet40-mvtn-viewgcn-12"


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def train(**options: Any) -> tuple[TrainOptions, dict[str, str]]:
    return resolve(TrainOptions, options, None, "train")


def mvtn(*words: str) -> Any:
    return CliRunner().invoke(app, list(words))


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_a_valid_training(name: str):
    config, origins = train(preset=name)
    training = config.training()
    preset = PRESETS[name]
    assert {field: getattr(training, field) for field in preset.settings} == preset.values
    assert {origins[field] for field in preset.settings} == {f"preset {name}"}
    assert preset.name == name and all(setting.source for setting in preset.settings.values())
    assert all(figure.source for figure in preset.figures if figure.percent is not None)


def test_every_preset_builds_its_networks():
    different = {}
    for name, preset in PRESETS.items():
        classes = CLASSES[preset.data.split(":")[0]]
        config = train(preset=name)[0].training()
        different.setdefault((classes, *(getattr(config, field) for field in NETWORK_FIELDS)), (name, config, classes))
    for name, config, classes in different.values():
        model = build_recogniser(config, classes, read_weights=False)
        assert model.selector.num_views == config.num_views, name
        assert model.selector.learned == ("mvtn" in name), name
        assert model.uses_views == (config.network not in ("pointnet", "dgcnn"))


def test_the_viewpoint_network_and_mvcnn_have_the_papers_size():
    config = train(preset="modelnet40-mvtn-mvcnn-12")[0].training()
    model = build_recogniser(config, 40, read_weights=False)
    regressor = [weights for name, weights in model.selector.named_parameters() if "encoder" not in name]
    assert sum(weights.numel() for weights in regressor) == 9092
    assert model.facts()["parameters"]["classifier"] == pytest.approx(11.20e6, rel=1e-3)


def test_options_environment_and_file_win(monkeypatch: pytest.MonkeyPatch):
    Path("mvtn.toml").write_text(f"preset = '{GCN}'\nclip = 5\nimage_size = 96\n")
    monkeypatch.setenv("MVTN_IMAGE_SIZE", "112")
    config, origins = train(num_views="20")
    assert (config.clip, config.image_size, config.num_views, config.lr) == (5, 112, 20, 1e-3)
    assert [origins[field] for field in ("preset", "clip", "image_size", "num_views", "lr", "seed")] == [
        *("mvtn.toml", "mvtn.toml", "MVTN_IMAGE_SIZE", "--num-views", f"preset {GCN}", "default")
    ]
    assert train(preset="auto")[0].lr == TrainConfig().lr


def test_what_hangs_on_a_setting_follows_it():
    assert train(preset=GCN, epochs="17")[0].first_stage_epochs == 10
    assert train(preset=GCN, epochs="17", first_stage_epochs="3")[0].first_stage_epochs == 3
    assert train(preset=DIRECT)[0].angles == "tanh"
    assert train(preset=DIRECT, views="fixed")[0].angles == "periodic"
    assert train(preset=DIRECT, compare="fixed,learned-direct")[0].angles == "tanh"
    assert train(preset=DIRECT, compare="fixed,jittered")[0].angles == "periodic"
    assert train(preset="modelnet40-mvtn-mvcnn-12-distance", views="jittered")[0].learn_distance == 1
    smaller = train(preset="modelnet40-viewgcn-20", num_views="6")[0]
    assert (smaller.num_views, smaller.layout) == (6, "spherical")
    assert train(preset=GCN, layout="icosahedral", views="fixed")[0].num_views == 12


def test_a_wrong_value_beside_a_preset_is_the_users_and_a_wrong_name_gets_the_nearest():
    with pytest.raises(UsageError, match="--epochs must be a whole number"):
        train(preset=GCN, epochs="many")
    with pytest.raises(UsageError, match=f"unknown preset 'modelnet40-mvtn-viewgc-12'; did you mean '{GCN}'"):
        train(preset="modelnet40-mvtn-viewgc-12")
    with pytest.raises(UsageError, match="unknown preset"):
        find_preset("")
    assert "epochs" not in settings_beside(GCN, {"epochs": 3})


def test_the_printed_toml_gives_the_same_settings(tmp_path: Path):
    for name in (GCN, DIRECT, "modelnet40-viewgcn-20", "scanobjectnn-hardest-dgcnn"):
        result = mvtn("presets", name)
        assert result.exit_code == 0 and tomllib.loads(result.stdout) == PRESETS[name].values
        file = tmp_path / "own.toml"
        file.write_text(result.stdout)
        assert resolve(TrainOptions, {}, file, "train")[0].training() == train(preset=name)[0].training()


def test_a_run_keeps_the_values_and_not_the_name(tmp_path: Path):
    class Prepared:
        classes, spec, title, address, known_view = ("a", "b"), "folder:x", "x", "00", False

        class settings:
            as_dict = staticmethod(dict)

    config = train(preset=GCN, epochs="9")[0].training()
    run = Run.create(tmp_path / "run", config, Prepared)
    assert "preset" not in tomllib.loads(run.config_path.read_text())
    kept = run.config
    assert {field: getattr(kept, field) for field in PRESETS[GCN].settings} == {
        field: getattr(config, field) for field in PRESETS[GCN].settings
    }


def test_the_list_is_one_tab_separated_line_each():
    rows = list(csv.DictReader(io.StringIO(mvtn("presets").stdout), delimiter="\t"))
    assert [row["preset"] for row in rows] == list(PRESETS)
    (row,) = (row for row in rows if row["preset"] == GCN)
    assert row["paper"] == "93.8 % accuracy; 92.9 % mAP" and "network=viewgcn" in row["sets"]


def test_json_has_every_source_and_a_wrong_name_ends_with_2():
    import json

    document = json.loads(mvtn("presets", GCN, "--json").stdout)
    (entry,) = document["presets"]
    assert entry["settings"] == PRESETS[GCN].values and set(entry["sources"]) == set(entry["settings"])
    assert entry["figures"][0]["percent"] == 93.8 and entry["notes"]
    result = mvtn("presets", "modelnet40-dgcn")
    assert result.exit_code == 2 and "did you mean 'modelnet40-dgcnn'" in result.stderr


def test_presets_need_no_torch():
    code = "import sys, mvtn_cli.presets; sys.exit('torch' in sys.modules or 'numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
