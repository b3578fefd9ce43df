from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from mvtn_cli.config import EvalConfig, TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.evaluation.evaluate import evaluate_run
from mvtn_cli.core.evaluation.given_views import cameras_of, moved, recognise_from
from mvtn_cli.core.evaluation.view_analysis import OWN, compare_answers, view_analysis, why_not
from mvtn_cli.core.evaluation.view_leak import class_leak, class_spread
from mvtn_cli.core.networks.class_views import class_mean_views
from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.networks.regressors import light_from
from mvtn_cli.core.networks.viewpoint import Placement
from mvtn_cli.core.training.checkpoint import write_weights
from mvtn_cli.core.training.predict import predict
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.views import Cameras, camera_rotations
from mvtn_cli.errors import UsageError

sys.path.insert(0, str(Path(__file__).parent))
from test_evaluate_run import toy

CLASSES = ("a", "b", "c", "d")
QUIET = Console(quiet=True)


def cameras(apart_deg: float, seed: int, shapes: int = 50, noise_deg: float = 15.0) -> tuple:
    """Two views of shapes of four classes, whose azimuths lie `apart_deg` from one class to the next."""
    random = np.random.default_rng(seed)
    labels = np.repeat(np.arange(4), shapes)
    noise = random.normal(0, noise_deg, (2, len(labels), 2))
    return apart_deg * labels[:, None] + 170 + noise[0], 30 + noise[1], labels


# The class in the angles


def test_angles_that_know_the_class_give_it_away_and_others_do_not():
    told = class_leak(cameras(90, 0), cameras(90, 1), 4)
    assert told["logistic"]["accuracy"] > 0.97 and told["forest"]["accuracy"] > 0.97
    assert told["chance"] == told["majority"] == 0.25 and (told["train_count"], told["test_count"]) == (200, 200)
    blind = class_leak(cameras(0, 0), cameras(0, 1), 4)
    for reader in ("logistic", "forest"):
        low, high = blind[reader]["accuracy_interval"]
        assert low < 0.25 < high and low < blind[reader]["accuracy"] < high


def test_differences_that_no_picture_shows_do_not_count():
    train, test = cameras(0.01, 0, noise_deg=1e-4), cameras(0.01, 1, noise_deg=1e-4)
    assert class_leak(train, test, 4)["forest"]["accuracy"] < 0.4
    assert class_leak(train, test, 4, blur_deg=0.0)["forest"]["accuracy"] == 1.0


def test_the_seam_of_the_circle_is_no_difference():
    azimuth, elevation, labels = cameras(90, 0)
    turned = azimuth + 360 * np.random.default_rng(2).integers(-2, 3, azimuth.shape)
    assert class_leak((azimuth, elevation, labels), (turned, elevation, labels), 4)["logistic"]["accuracy"] > 0.97


def test_the_majority_is_that_of_the_training_shapes_and_one_class_can_not_be_told_apart():
    azimuth, elevation, labels = cameras(90, 0)
    train = (azimuth[:60], elevation[:60], labels[:60])  # 50 of class a, 10 of b
    assert class_leak(train, (azimuth[40:60], elevation[40:60], labels[40:60]), 4)["majority"] == 0.5
    alone = class_leak((azimuth[:50], elevation[:50], labels[:50]), train, 4, blur_deg=0.0)
    assert alone["forest"]["accuracy"] == alone["majority"] == pytest.approx(50 / 60)


def test_the_class_explains_all_or_nothing_of_the_spread():
    azimuth, elevation, labels = cameras(90, 0, noise_deg=0.0)
    found = class_spread(azimuth, elevation, labels)
    assert found["explained"] == pytest.approx(1) and found["within_deg"] == pytest.approx(0, abs=1e-5)
    assert found["total_deg"] > 40
    same = class_spread(*cameras(0, 0, noise_deg=0.0))
    assert np.isnan(same["explained"]) and same["total_deg"] == pytest.approx(0, abs=1e-5)


def test_labels_by_chance_explain_as_much_as_is_said():
    azimuth, elevation, labels = cameras(0, 3, shapes=10)
    random = np.random.default_rng(0)
    shares = [class_spread(azimuth, elevation, random.permutation(labels))["explained"] for _ in range(400)]
    said = class_spread(azimuth, elevation, labels)["by_chance"]
    assert said == 3 / 39 and np.mean(shares) == pytest.approx(said, rel=0.06)


# Seen from other sides


def learned(**more) -> tuple:
    """A recogniser whose offsets are not zero: each shape gets its own cameras."""
    given = {"views": "learned-spherical", "num_views": 2, "image_size": 16, "seed": 1, **more}
    config = TrainConfig(dataset="toy", **given)
    model = build_recogniser(config, 2).eval()
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for weight in model.selector.parameters():
            weight += 0.2 * torch.randn(weight.shape, generator=generator)
    return model, config


def test_the_cameras_alone_are_those_of_an_evaluation_and_give_the_same_answers():
    model, config = learned(learn_distance=1.5, learn_light=True)
    shapes, indices = toy(), list(range(16))
    found = predict(model, shapes, indices, config, batch_size=5)
    azimuth, elevation = cameras_of(model, shapes, indices, config, batch_size=3, console=QUIET)
    assert azimuth.std(axis=0).min() > 0.1, "each shape has its own"
    assert np.allclose(azimuth, found.azimuth_deg, atol=1e-3), "up to the rounding of another batch"
    assert np.allclose(elevation, found.elevation_deg, atol=1e-3)
    views = {"own": (azimuth, elevation), "turned": (azimuth + 40, elevation)}
    logits = recognise_from(model, shapes, indices, views, config, batch_size=7, console=QUIET)
    off = {name: np.abs(logits[name] - found.logits).max() for name in views}
    assert off["own"] < 1e-4 and off["turned"] > 20 * off["own"]


def test_the_class_mean_of_views_that_are_all_alike_changes_nothing():
    model, config = learned()
    for weight in model.selector.parameters():
        torch.nn.init.zeros_(weight)
    shapes, indices = toy(), list(range(16))
    found = predict(model, shapes, indices, config, batch_size=5)
    labels = found.labels
    azimuth, elevation = class_mean_views(found.azimuth_deg, found.elevation_deg, labels, 2)
    views = {"mean": (azimuth[labels], elevation[labels])}
    logits = recognise_from(model, shapes, indices, views, config, batch_size=5, console=QUIET)
    assert np.allclose(logits["mean"], found.logits, atol=1e-4)


def test_a_moved_camera_keeps_its_distance_and_its_light_beside_it():
    random = torch.Generator().manual_seed(0)
    azimuth, elevation, distance = (50 * torch.randn(3, 2, generator=random) for _ in range(3))
    offset = torch.randn(3, 2, 2, generator=random)
    old = Placement(Cameras(azimuth, elevation, distance), light_from(offset, camera_rotations(azimuth, elevation)))
    new = moved(old, azimuth + 70, -elevation)
    expected = light_from(offset, camera_rotations(azimuth + 70, -elevation))
    assert new.light is not None and torch.allclose(new.light, expected, atol=1e-6)
    assert torch.equal(new.cameras.distance, distance)
    assert moved(Placement(old.cameras, None), azimuth, elevation).light is None


def test_answers_are_compared_shape_by_shape():
    own = np.array([[2.0, 0], [2, 0], [2, 0], [0, np.nan]], np.float32)
    other = np.array([[0.0, 2], [2, 0], [0, 2], [0, 2]], np.float32)
    first, second = compare_answers(np.array([0, 0, 1, 1]), {OWN: own, "per-class-mean": other}, ["a", "b"])
    assert (first["accuracy"], first["gained"], first["lost"]) == (0.5, 0, 0)
    assert (second["accuracy"], second["gained"], second["lost"]) == (0.75, 2, 1)
    assert second["uses_label"] and not first["uses_label"]


def test_mean_views_come_from_training_shapes_and_the_true_class_chooses(monkeypatch):
    model, config = learned()
    shapes, train, tested = toy(), list(range(8)), list(range(8, 16))
    seen: dict = {}

    def spy(model, shapes, indices, views, *arguments, **more):
        seen.update(views)
        return dict.fromkeys(views, found.logits)

    monkeypatch.setattr("mvtn_cli.core.evaluation.view_analysis.recognise_from", spy)
    found = predict(model, shapes, tested, config, batch_size=8)
    result = view_analysis(
        model, shapes, train, tested, found, config, ["flat", "tall"], batch_size=8, seed=0, console=QUIET
    )
    of_train = predict(model, shapes, train, config, batch_size=8)
    by_class, _ = class_mean_views(of_train.azimuth_deg, of_train.elevation_deg, of_train.labels, 2)
    assert np.allclose(seen["per-class-mean"][0], by_class[found.labels])
    assert len(np.unique(seen["overall-mean"][0], axis=0)) == 1
    assert (result["train_count"], result["test_count"]) == (8, 8)
    assert [row["name"] for row in result["per_class"]] == ["flat", "tall"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"views": "fixed"}, "fixed: it judges every shape from the same ones"),
        ({"views": "jittered"}, "jittered: it judges every shape from the same ones"),
        ({"views": "random"}, "drawn at random"),
        ({"network": "pointnet", "views": "fixed"}, "pointnet looks at points alone"),
    ],
)
def test_views_that_look_at_no_shape_are_not_analysed(more, said):
    model, config = learned(**more)
    result = view_analysis(
        model, toy(), [0], [1], SimpleNamespace(), config, ["a", "b"], batch_size=1, seed=0, console=QUIET
    )
    assert list(result) == ["skipped"] and said in result["skipped"] and why_not(learned()[0]) is None


# As a user asks for it


@pytest.fixture
def run(tmp_path) -> Run:
    model, config = learned()
    made = Run.create(tmp_path / "runs" / "a", config, toy())
    write_weights(made.weights_path("best"), model.state_dict(), {"epoch": 1})
    return made


def test_an_evaluation_has_an_analysis_only_if_asked(run):
    result = evaluate_run(run, toy(), EvalConfig(device="cpu"), QUIET)
    assert result["view_analysis"] is None
    result = evaluate_run(run, toy(), EvalConfig(device="cpu", view_analysis=True), QUIET)
    written = json.loads((run.path / "result.json").read_text())["view_analysis"]
    assert [row["views"] for row in written["views"]] == ["per-instance", "per-class-mean", "overall-mean"]
    assert written["views"][0]["accuracy"] == result["accuracy"]
    assert written["train_count"] == 6, "two of the eight are held out"
    assert written["leak"]["test_count"] == 8 and written["spread"]["total_deg"] > 0.1
    again = evaluate_run(run, toy(), EvalConfig(device="cpu", view_analysis=True), QUIET)
    assert again["view_analysis"]["leak"] == result["view_analysis"]["leak"]


def test_training_shapes_are_refused(run):
    with pytest.raises(UsageError, match="can't be measured on them") as refused:
        evaluate_run(run, toy(), EvalConfig(device="cpu", view_analysis=True, split="train"), QUIET)
    assert refused.value.hint == "leave out --view-analysis, or use --split test"
