"""What is watched: pictures with content, views that can learn, numbers that are finite, whole files."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from mvtn_cli.core.training import watch
from mvtn_cli.core.training.checkpoint import (
    finite_or_null,
    read_state,
    read_weights,
    write_state,
    write_weights,
)
from mvtn_cli.core.training.judge import is_better
from mvtn_cli.errors import DataError, UsageError


def test_uniform_pictures_are_refused_whatever_their_colours():
    uniform = torch.rand(4, 2, 3, 1, 1).expand(4, 2, 3, 16, 16)
    with pytest.raises(UsageError, match="nothing can be seen"):
        watch.check_something_is_seen(uniform)
    with pytest.raises(UsageError):
        watch.check_something_is_seen(torch.full((1, 1, 3, 8, 8), math.nan))


def test_a_small_shape_in_the_picture_is_enough():
    picture = torch.zeros(4, 2, 3, 16, 16)
    picture[..., 7, 7] = 0.5
    watch.check_something_is_seen(picture)


def test_learned_views_without_a_gradient_are_refused_unless_asked_for():
    config = SimpleNamespace(views="learned-direct", gradient="none", allow_no_gradient=False)
    with pytest.raises(UsageError, match="no gradient reaches the cameras"):
        watch.check_views_can_learn(config)
    config.allow_no_gradient = True
    watch.check_views_can_learn(config)


def test_the_view_error_is_the_one_of_the_nearest_view_across_the_wrap_and_over_the_pole():
    azimuth = [[10.0, 100.0], [359.0, 90.0], [0.0, 90.0], [0.0, 0.0]]
    elevation = [[0.0, 0.0], [0.0, 0.0], [100.0, 0.0], [0.0, 0.0]]
    known = [15.0, -3.0, 178.0, math.nan]  # 5, 2 and, from beyond the pole, 2 degrees off
    assert watch.view_health(azimuth, elevation, known)["view_error_deg"] == pytest.approx(2.0)
    assert watch.view_health(azimuth, elevation, [math.nan] * 4)["view_error_deg"] is None


def test_spread_is_between_shapes_and_apart_within_one():
    azimuth = np.tile([0.0, 90.0], (5, 1))
    health = watch.view_health(azimuth, np.zeros((5, 2)), np.full(5, math.nan))
    assert health["view_spread_deg"] == pytest.approx(0, abs=1e-6)
    assert health["view_apart_deg"] == pytest.approx(90)
    assert watch.view_health(azimuth[:, :1], np.zeros((5, 1)), np.full(5, math.nan))["view_apart_deg"] is None


def test_collapse_is_told_from_a_start_that_has_not_moved_yet():
    assert watch.collapse(saturation=0.0, spread_deg=0.0, apart_deg=60.0) is None
    assert watch.collapse(saturation=math.nan, spread_deg=0.0, apart_deg=None) is None
    assert "saturated" in watch.collapse(saturation=0.99, spread_deg=0.5, apart_deg=60.0)
    assert "same side" in watch.collapse(saturation=0.0, spread_deg=30.0, apart_deg=0.4)
    assert watch.collapse(saturation=0.99, spread_deg=20.0, apart_deg=60.0) is None


@pytest.mark.parametrize(
    ("accuracy", "loss", "better"),
    [
        (0.6, 9.0, True),
        (0.5, 0.9, True),
        (0.5, 1.0, False),
        (0.5, math.nan, False),
        (0.4, 0.1, False),
        (None, None, True),
    ],
)
def test_the_best_epoch_goes_by_accuracy_then_by_loss(accuracy, loss, better):
    best = {"val_accuracy": 0.5, "val_loss": 1.0}
    assert is_better({"val_accuracy": accuracy, "val_loss": loss}, best) is better
    assert is_better({"val_accuracy": accuracy, "val_loss": loss}, None)


def test_what_is_not_finite_is_named_by_its_network():
    weights = {name: torch.nn.Parameter(torch.ones(3)) for name in ("classifier", "viewpoint network")}
    optimisers = {name: torch.optim.SGD([weight], lr=1.0) for name, weight in weights.items()}
    for weight in weights.values():
        weight.grad = torch.ones(3)
    assert watch.not_finite(1.0, optimisers) is None
    weights["viewpoint network"].grad[1] = math.inf
    assert watch.not_finite(1.0, optimisers) == "the gradient of the viewpoint network"
    assert watch.not_finite(math.nan, optimisers) == "the loss"


def test_weights_and_states_come_back_as_they_were(tmp_path):
    weights = {"a": torch.randn(3, 4).T, "b": torch.tensor(7)}
    write_weights(tmp_path / "w.safetensors", weights, {"epoch": 3})
    back = read_weights(tmp_path / "w.safetensors")
    assert all(torch.equal(back[name], weights[name]) for name in weights)
    state = {"weights": weights, "best": None, "norms": [0.1, 1e300], "step": 3}
    write_state(tmp_path / "s.pt", state)
    read = read_state(tmp_path / "s.pt")
    assert read["norms"] == state["norms"] and torch.equal(read["weights"]["a"], weights["a"])


def test_broken_files_are_clear_errors(tmp_path):
    for name, read in (("s.pt", read_state), ("w.safetensors", read_weights)):
        (tmp_path / name).write_bytes(b"PK broken")
        with pytest.raises(DataError, match=name):
            read(tmp_path / name)


def test_json_has_no_nan():
    assert finite_or_null({"a": [1.0, math.nan], "b": (math.inf,)}) == {"a": [1.0, None], "b": [None]}
