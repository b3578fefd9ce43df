"""Runs are judged on the shapes that were asked for, each evaluation once."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from solids import Toy, cloud, solid

from mvtn_cli.config import EvalConfig, TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.evaluation.evaluate import evaluate_run
from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.render import Look, pack
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.robustness import CorruptedShapes, Corruption, evaluating, measure
from mvtn_cli.core.robustness.cells import FILE, read_cells
from mvtn_cli.core.robustness.files import document_of, write_files
from mvtn_cli.core.robustness.plan import plan_of
from mvtn_cli.core.robustness.turning import turn_about_y, turned
from mvtn_cli.core.store import Store
from mvtn_cli.core.training.fixed_views import KeptShapes, with_kept_views
from mvtn_cli.core.training.predict import load_model, predict
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import DataError, UsageError
from mvtn_cli.robustness_config import RobustnessConfig

QUIET = Console(quiet=True)


def config_of(**wanted: Any) -> RobustnessConfig:
    return RobustnessConfig(device="cpu", repeats=wanted.pop("repeats", 2), **wanted)


def measured(runs: list[Run], prepared: Any, config: RobustnessConfig) -> list[measure.Measured]:
    indices = measure.chosen_indices(prepared, config.limit, config.seed)
    return measure.measure(runs, prepared, indices, plan_of(config), config, QUIET)


def document(runs: list[Run], prepared: Any, config: RobustnessConfig) -> dict[str, Any]:
    indices = measure.chosen_indices(prepared, config.limit, config.seed)
    return document_of(measured(runs, prepared, config), prepared, indices, config)


# What is measured


def test_clean_shapes_and_no_occlusion_give_exactly_what_eval_gives(make_run):
    run, toy = make_run(Toy(), views="learned-spherical"), Toy()
    result = evaluate_run(run, toy, EvalConfig(device="cpu"), QUIET)
    found = measured([run], toy, config_of(occlude=[0.0]))[0].cells
    assert len(found) == 7
    for cell in found:
        assert (cell["correct"], cell["class_accuracy"]) == (result["correct"], result["class_accuracy"])
        assert cell["predicted"] == found[0]["predicted"] and cell["points_left"] == 1.0
    model, indices = load_model(run, device="cpu"), toy.split("test")
    nothing = CorruptedShapes(toy, Corruption("occlude", 0.0, "+x", "extent"))
    logits = [predict(model, shapes, indices, run.config, batch_size=3).logits for shapes in (toy, nothing)]
    assert np.array_equal(*logits)


def test_views_that_are_kept_of_a_shape_are_never_shown_for_what_has_become_of_it(make_run, tmp_path):
    toy = Toy()
    toy.store = Store(tmp_path / "store")
    run = make_run(toy, views="fixed")
    model, indices = load_model(run, device="cpu"), toy.split("test")
    kept = with_kept_views(toy, run.config, QUIET, model.device)
    assert isinstance(kept, KeptShapes)
    clean = predict(model, kept, indices, run.config, batch_size=8).logits
    assert any((tmp_path / "store" / "views").rglob("*.npz"))
    corrupted = CorruptedShapes(toy, Corruption("occlude", 0.5, "+y", "extent"))
    assert with_kept_views(corrupted, run.config, QUIET, model.device) is corrupted
    before = tally().rasterised
    shown = predict(model, corrupted, indices, run.config, batch_size=8).logits
    assert tally().rasterised > before
    bare = CorruptedShapes(Toy(), corrupted.corruption)  # has no store at all
    assert np.array_equal(shown, predict(model, bare, indices, run.config, batch_size=8).logits)
    assert np.abs(shown - clean).max() > 1e-3
    # nor does what was corrupted end up in the store
    assert np.array_equal(clean, predict(model, kept, indices, run.config, batch_size=8).logits)
    assert np.array_equal(clean, measure_clean(run, toy, model))


def measure_clean(run: Run, toy: Toy, model: Any) -> np.ndarray:
    """The logits that a measurement sees of clean shapes."""
    served = CorruptedShapes(toy, Corruption("clean"))
    return predict(model, served, toy.split("test"), run.config, batch_size=8).logits


@pytest.mark.parametrize("kind", ["mesh", "points"])
@pytest.mark.parametrize("angle", [17.3, 90.0, -141.2])
def test_turning_shape_light_and_cameras_together_changes_no_logit(kind: str, angle: float):
    settings = {"views": "fixed", "layout": "circular", "num_views": 3, "image_size": 32, "elevation": 20.0}
    plain = build_recogniser(TrainConfig(**settings), 5).eval()
    moved = build_recogniser(TrainConfig(**settings, azimuth=angle), 5).eval()
    moved.load_state_dict(plain.state_dict())
    shapes = [(cloud if kind == "points" else solid)(seed, points=256) for seed in range(3)]
    rotation = turn_about_y(angle)
    light = np.array([[0.6, 0.64, 0.48]] * 3)
    look = replace(Look.evaluation(plain.config, 3, kind), light_direction=light.astype(np.float32))
    turned_look = replace(look, light_direction=(light @ rotation.T).astype(np.float32))
    with torch.no_grad():
        before = plain(pack(shapes), look).logits
        after = moved(pack([turned(shape, rotation) for shape in shapes]), turned_look).logits
        shape_alone = plain(pack([turned(shape, rotation) for shape in shapes]), look).logits
    assert (before - after).abs().max() < 1e-4
    assert (before - shape_alone).abs().max() > 1e-3


def test_answers_do_not_depend_on_the_batch_and_seeds_reproduce(make_run, tmp_path):
    toy = Toy()
    runs = [make_run(toy, name, views="learned-spherical") for name in "abc"]
    wanted = {"rotate": [90], "so3": True, "noise": [0.05], "drop_points": [0.5]}
    answers = [
        [cell["predicted"] for cell in measured([run], toy, config_of(**wanted, **more))[0].cells]
        for run, more in zip(runs, ({"batch_size": 1}, {"batch_size": 8}, {"seed": 1}), strict=True)
    ]
    assert answers[0] == answers[1]
    assert answers[0][0] == answers[2][0]


def test_clouds_are_measured_as_meshes_are(make_run):
    toy = Toy(as_clouds=True)
    found = document([make_run(toy)], toy, config_of(occlude=[0.5], directions="+x,y", scale="0.5"))
    occlude, scale = found["runs"][0]["corruptions"]
    assert list(occlude["by"]) == ["+x", "+y"] and occlude["points_left"] == 0.5 and occlude["area_left"] is None
    assert scale["evaluations"] == 1 and scale["sd"] is None


@pytest.mark.parametrize(("network", "sees_points"), [("mvcnn", False), ("pointnet", True)])
def test_every_network_sees_the_damage_that_is_before_its_eyes(make_run, network: str, sees_points: bool):
    toy = Toy()
    run = make_run(toy, network=network)
    model, indices = load_model(run, device="cpu"), toy.split("test")

    def logits(corruption: Corruption) -> np.ndarray:
        return predict(model, CorruptedShapes(toy, corruption), indices, run.config, batch_size=8).logits

    clean = logits(Corruption("clean"))
    for corruption in (Corruption("occlude", 0.4, "+y", "quantile"), Corruption("so3"), Corruption("scale", 0.5)):
        assert (np.abs(logits(corruption) - clean).max(axis=1) > 1e-6).all()
    assert np.array_equal(logits(Corruption("drop-points", 0.9)), clean) is not sees_points


# Which


def test_nothing_asked_for_is_the_papers_tables():
    plan = plan_of(RobustnessConfig())
    assert len(plan) == 1 + 2 * 10 + 5 * 6 and plan[0].kind == "clean"
    assert {(one.kind, one.strength) for one in plan[1:]} == {
        *(("rotate", angle) for angle in (90, 180)),
        *(("occlude", ratio) for ratio in (0.1, 0.2, 0.3, 0.5, 0.75)),
    }
    assert len(set(plan)) == len(plan)


def test_only_what_was_asked_for_is_planned_and_each_strength_once():
    plan = plan_of(config_of(noise="0.02,0.01,0.02", so3=True, repeats=3))
    assert [(one.kind, one.strength, one.repeat) for one in plan[1:]] == [
        *(("so3", 0.0, repeat) for repeat in range(3)),
        *(("noise", sd, repeat) for sd in (0.01, 0.02) for repeat in range(3)),
    ]


def test_a_limit_takes_all_classes_alike_and_always_the_same():
    indices = measure.chosen_indices(Toy(), 4, 0)
    assert indices == sorted(indices) == measure.chosen_indices(Toy(), 4, 0)
    assert sorted(Toy().records[i].label for i in indices) == [0, 0, 1, 1]
    assert measure.chosen_indices(Toy(), 99, 0) == Toy().split("test")


def test_no_test_shapes_is_an_error():
    toy = Toy()
    toy.records = toy.records[:8]
    with pytest.raises(DataError, match="no labelled shapes for split 'test' in toy"):
        measure.chosen_indices(toy, None, 0)


def test_runs_of_different_data_share_no_table(make_run):
    a, b = make_run(Toy(), "a"), make_run(Toy(spec="other", address="xyz"), "b")
    with pytest.raises(UsageError, match=r"a was trained on toy and .*b on other, so that they share no test shapes"):
        measure.check_same_data([a, b])
    changed = make_run(Toy(address="xyz"), "c")
    with pytest.raises(UsageError, match="toy, prepared in another way or with other contents, so"):
        measure.check_same_data([a, changed])
    with pytest.raises(UsageError, match=r"knows the classes .* \(2\), and toy has x, y, z \(3\)"):
        a.check_classes(Toy(classes=("x", "y", "z")))
    measure.check_same_data([a, make_run(Toy(), "d")])


# Each once


@pytest.fixture
def evaluations(monkeypatch: pytest.MonkeyPatch) -> list[Corruption]:
    """Filled with what is really evaluated."""
    done: list[Corruption] = []

    def counting(model: Any, shapes: CorruptedShapes, *more: Any, **options: Any) -> Any:
        found = predict(model, shapes, *more, **options)
        done.append(shapes.corruption)
        return found

    monkeypatch.setattr(evaluating, "predict", counting)
    return done


def test_what_is_finished_is_not_done_again(make_run, evaluations):
    run, toy = make_run(Toy()), Toy()
    first = document([run], toy, config_of(rotate=[90]))
    assert [one.kind for one in evaluations] == ["clean", "rotate", "rotate"]
    assert document([run], toy, config_of(rotate=[90], batch_size=4))["runs"] == first["runs"]
    assert len(evaluations) == 3
    open_size = document([run], toy, config_of(rotate=[90], batch_size=None))
    assert open_size["batch_size"] == run.config.batch_size and len(evaluations) == 3
    document([run], toy, config_of(rotate=[90, 180], scale=[0.5], repeats=3))
    new = [(one.kind, one.strength, one.repeat) for one in evaluations[3:]]
    assert new == [("rotate", 90, 2), *(("rotate", 180, n) for n in range(3)), ("scale", 0.5, 0)]


@pytest.mark.parametrize("damage", [b"", b'{"key": "abc", "kin', b"\xff\x00\n", b"[]\n", b"\n"])
def test_a_kill_costs_the_evaluation_that_it_came_into(make_run, evaluations, monkeypatch, damage: bytes):
    run, toy = make_run(Toy()), Toy()
    counting = evaluating.predict

    def interrupted(*words: Any, **options: Any) -> Any:
        if len(evaluations) == 3:
            raise KeyboardInterrupt
        return counting(*words, **options)

    monkeypatch.setattr(evaluating, "predict", interrupted)
    with pytest.raises(KeyboardInterrupt):
        document([run], toy, config_of(rotate=[90, 180]))
    with (run.path / FILE).open("ab") as file:
        file.write(damage)
    monkeypatch.setattr(evaluating, "predict", counting)
    gone_on = document([run], toy, config_of(rotate=[90, 180]))
    assert [(one.strength, one.repeat) for one in evaluations] == [(0, 0), (90, 0), (90, 1), (180, 0), (180, 1)]
    assert len(read_cells(run.path)) == 5
    whole = make_run(toy, "whole")
    assert (
        document([whole], toy, config_of(rotate=[90, 180]))["runs"][0]["corruptions"]
        == (gone_on["runs"][0]["corruptions"])
    )


def test_other_weights_data_subsets_and_settings_are_measured_anew(make_run, evaluations):
    run, toy = make_run(Toy()), Toy()
    document([run], toy, config_of(scale=[0.5]))
    assert len(evaluations) == 2
    document([run], toy, config_of(scale=[0.5], limit=4))
    assert len(evaluations) == 4
    document([run], Toy(address="other"), config_of(scale=[0.5]))
    assert len(evaluations) == 6
    make_run(toy, "a", seed=5)  # trained again, in the same folder
    document([run], toy, config_of(scale=[0.5]))
    assert len(evaluations) == 8


def test_random_views_depend_on_seed_and_batch_and_others_do_not(make_run, evaluations):
    toy = Toy()
    for run, expected in ((make_run(toy, "r", views="random"), 3), (make_run(toy, "f"), 1)):
        evaluations.clear()
        for more in ({}, {"seed": 1}, {"batch_size": 3}):
            measured_clean(run, toy, **more)
        assert len(evaluations) == expected


def measured_clean(run: Run, toy: Toy, **more: Any) -> None:
    """Measure clean shapes alone."""
    config = config_of(**more)
    measure.measure([run], toy, toy.split("test"), [Corruption("clean")], config, QUIET)


# What is said and written


def test_the_document_adds_up_and_the_files_say_the_same(make_run, tmp_path):
    toy = Toy()
    runs = [make_run(toy, "a"), make_run(toy, "b", seed=3, views="learned-spherical")]
    config = config_of(
        rotate=[45, 180], so3=True, occlude=[0.3], noise=[0.1], drop_points=[0.5], scale=[0.5], repeats=3
    )
    cells = measured(runs, toy, config)
    answer = document_of(cells, toy, toy.split("test"), config)
    written = write_files(tmp_path / "out", answer, cells)
    assert json.loads((tmp_path / "out" / "robustness.json").read_text())["runs"] == json.loads(
        json.dumps(written["runs"])
    )
    for run, one in zip(answer["runs"], cells, strict=True):
        assert [entry["kind"] for entry in run["corruptions"]] == [
            *("rotate", "rotate", "so3", "occlude", "noise", "drop-points", "scale")
        ]
        for entry in run["corruptions"]:
            mine = [c for c in one.cells if (c["kind"], c["strength"]) == (entry["kind"], entry["strength"])]
            values = [cell["correct"] / 8 for cell in mine]
            assert entry["mean"] == pytest.approx(np.mean(values)) and len(entry["by"]) == len(values)
            assert entry["low"] == min(values) and entry["high"] == max(values)
            if len(values) > 1:
                assert entry["sd"] == pytest.approx(np.std(values, ddof=1))
            change = entry["mean"] - run["clean"]["accuracy"]
            assert entry["difference"]["mean"] == pytest.approx(change)
            assert entry["difference"]["found"] - entry["difference"]["lost"] == pytest.approx(change)
            assert entry["difference"]["low"] <= change + 1e-12 and entry["difference"]["high"] >= change - 1e-12
    lines = (tmp_path / "out" / "robustness.csv").read_text().splitlines()
    assert len(lines) == 1 + sum(len(one.cells) for one in cells)
    first = {name: (tmp_path / "out" / name).read_bytes() for name in ("robustness.svg", "robustness.png")}
    assert b"share taken away" in first["robustness.svg"] and first["robustness.png"][1:4] == b"PNG"
    write_files(tmp_path / "again", answer, cells)
    assert (tmp_path / "again" / "robustness.svg").read_bytes() == first["robustness.svg"]
