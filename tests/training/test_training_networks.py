"""What the loop does for networks other than MVCNN: stages, points alone, views of another run."""

from __future__ import annotations

import pytest
import torch
from safetensors.torch import save_file

from mvtn_cli.config import TrainConfig
from mvtn_cli.core.networks.weights import read_weights
from mvtn_cli.core.training import schedules
from mvtn_cli.core.training.find import default_name
from mvtn_cli.core.training.loop import train
from mvtn_cli.core.training.predict import load_model, predict
from mvtn_cli.errors import DataError, UsageError


def test_the_first_stage_is_never_the_best_and_leaves_the_views_alone(settings, boxes, quiet):
    config = settings(network="viewgcn", num_views=4, epochs=3, first_stage_epochs=2, views="learned-spherical")
    run = train(config, boxes, quiet)
    assert [line["stage"] for line in run.metrics()] == ["views", "views", "shapes"]
    assert [line["view_grad_norm"] for line in run.metrics()][:2] == [None, None]
    assert run.metrics()[2]["view_grad_norm"] > 0
    assert run.best["epoch"] == 3
    assert run.info["model"]["network"] == "viewgcn"


def test_each_stage_has_whole_schedules():
    config = TrainConfig(network="viewgcn", epochs=5, first_stage_epochs=2)
    progress = [schedules.progress_in_stage(config, epoch, 0, 1) for epoch in range(5)]
    assert progress == pytest.approx([1 / 4, 3 / 4, 1 / 6, 3 / 6, 5 / 6])
    assert [schedules.stage_of(config, epoch) for epoch in range(5)] == ["views"] * 2 + ["shapes"] * 3


@pytest.mark.parametrize("network", ["pointnet", "dgcnn"])
def test_a_network_of_points_trains_without_pictures(network, settings, boxes, quiet):
    config = settings(network=network, views="fixed", epochs=1)
    run = train(config, boxes, quiet)
    assert not list(run.path.glob("views_*.npz"))
    answers = predict(load_model(run), boxes, [0, 1], config, batch_size=2)
    again = predict(load_model(run), boxes, [0, 1], config, batch_size=2)
    assert answers.logits.shape == (2, 4) and (answers.logits == again.logits).all()
    assert network in run.name and "fixed" not in run.name


def test_the_views_of_another_run_stay_as_they_are(settings, boxes, quiet):
    first = train(settings(views="learned-spherical", views_lr=0.05, name="first"), boxes, quiet)
    config = settings(views="transferred", views_from="first", name="second", seed=5)
    second = train(config, boxes, quiet)
    mine, theirs = (predict(load_model(run), boxes, range(4), run.config, batch_size=4) for run in (second, first))
    assert torch.equal(torch.tensor(mine.azimuth_deg), torch.tensor(theirs.azimuth_deg))


def test_weights_of_another_version_are_refused_in_one_sentence(settings, boxes, quiet):
    run = train(settings(views="learned-spherical", epochs=1), boxes, quiet)
    weights = read_weights(run.weights_path())
    older = {name: tensor for name, tensor in weights.items() if not name.startswith("selector.encoder.last.")}
    save_file(older, run.weights_path())
    with pytest.raises(DataError, match=r"don't fit its config\.toml: .*encoder\.last\.weight") as refusal:
        load_model(run)
    assert "\n" not in refusal.value.message and "another version" in refusal.value.hint


def test_settings_of_networks_that_do_not_go_together_are_refused(settings, boxes, quiet):
    with pytest.raises(UsageError, match="looks at points alone"):
        train(settings(network="dgcnn", views="learned-spherical"), boxes, quiet)
    with pytest.raises(UsageError, match="leaves none"):
        TrainConfig(network="viewgcn", epochs=3, first_stage_epochs=3)
    with pytest.raises(UsageError, match="belong together"):
        TrainConfig(views="transferred")
    with pytest.raises(DataError, match="not the folder of a run"):
        train(settings(views="transferred", views_from="nowhere"), boxes, quiet)


def test_points_alone_take_fixed_views_and_the_published_number_of_points():
    config = TrainConfig(network="pointnet")
    assert (config.views, config.encoder_points) == ("fixed", 1024)
    assert TrainConfig(network="pointnet", encoder_points=256).encoder_points == 256


def test_a_run_is_named_after_its_network(boxes):
    boxes.spec = "folder:/data/boxes"
    named = {network: default_name(TrainConfig(network=network), boxes) for network in ("mvcnn", "viewgcn", "dgcnn")}
    assert named == {
        "mvcnn": "boxes-learned-spherical-6v-s0",
        "viewgcn": "boxes-viewgcn-learned-spherical-6v-s0",
        "dgcnn": "boxes-dgcnn-s0",
    }
