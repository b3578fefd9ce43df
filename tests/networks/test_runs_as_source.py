"""What another run left behind: its viewpoint network, its backbone; and what is said where they don't fit."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
import tomli_w
import torch
from safetensors.torch import load_file, save_file
from tetrahedra import CLASSES, config, look

from mvtn_cli.core.networks import Recogniser, build_backbone, build_recogniser
from mvtn_cli.core.networks.backbones import PLAIN_MEAN
from mvtn_cli.errors import DataError, UsageError


def stir(model: Recogniser) -> None:
    """Give every weight and statistic a value that no new network has."""
    generator = torch.Generator().manual_seed(9)
    with torch.no_grad():
        for name, value in model.state_dict().items():
            if value.is_floating_point():
                noise = 0.02 * torch.randn(value.shape, generator=generator)
                value.add_(noise.abs() if name.endswith(("running_var", "deviation")) else noise)


def run(folder: Path, **more: Any) -> Recogniser:
    """The folder of a finished run, and the recogniser that it holds."""
    settings = config(**more)
    model = build_recogniser(settings, CLASSES).eval()
    stir(model)
    save(folder, model)
    return model


def save(folder: Path, model: Recogniser, checkpoint: str = "best") -> None:
    folder.mkdir(exist_ok=True)
    kept = {name: value for name, value in vars(model.config).items() if isinstance(value, str | bool | int | float)}
    (folder / "config.toml").write_text(tomli_w.dumps(kept))
    save_file({n: v.contiguous() for n, v in model.state_dict().items()}, folder / f"{checkpoint}.safetensors")


LEARNED = [
    {"views": "learned-direct"},
    {"views": "learned-direct", "angles": "tanh", "regressor": "reference"},
    {"views": "learned-circular", "learn_distance": 1.4, "learn_light": True},
    {"views": "learned-random", "encoder": "pointnet", "tnets": True},
]


@pytest.mark.parametrize("source", LEARNED)
def test_transferred_views_are_those_of_the_other_run_and_stay(source, tmp_path, calls, batch):
    theirs = run(tmp_path / "one", **source)
    ours = build_recogniser(config(views="transferred", views_from=tmp_path / "one", fov=40.0), CLASSES)
    generator = [torch.Generator().manual_seed(0) for _ in range(3)]
    expected = theirs.place(batch, generator=generator[0])
    for training in (False, True):
        placed = ours.train(training).place(batch, explore_deg=30.0, generator=generator[1 + training])
        for name in ("azimuth_deg", "elevation_deg", "distance"):
            assert torch.equal(getattr(placed.cameras, name), getattr(expected.cameras, name))
        assert (placed.light is None) == (expected.light is None)
        assert placed.cameras.fov_deg == 40
    assert not ours.selector.learned and ours.viewpoint_parameters() == []
    ours.loss(ours(batch, look(ours.config)), batch.labels).backward()
    assert all(weight.grad is None for weight in ours.selector.parameters())
    assert ours.network.head.classifier.weight.grad.abs().max() > 0


def test_run_with_transferred_views_needs_the_other_one_no_more(tmp_path, calls, batch):
    run(tmp_path / "one", views="learned-circular", encoder="dgcnn", encoder_points=7)
    settings = config(views="transferred", views_from=tmp_path / "one")
    ours = build_recogniser(settings, CLASSES).eval()
    save(tmp_path / "two", ours)
    shutil.rmtree(tmp_path / "one")
    again = build_recogniser(settings, CLASSES, read_weights=False)
    again.load_state_dict(load_file(tmp_path / "two" / "best.safetensors"))
    one, other = (model.eval()(batch, look(settings)) for model in (ours, again))
    assert torch.equal(one.logits, other.logits) and torch.equal(one.cameras.azimuth_deg, other.cameras.azimuth_deg)
    assert again.selector.encoder_points == 7
    # and a third one may take the views on from there
    third = build_recogniser(config(views="transferred", views_from=tmp_path / "two"), CLASSES).eval()
    assert torch.equal(third.choose_cameras(batch).azimuth_deg, one.cameras.azimuth_deg)


def test_runs_that_have_no_such_views_are_refused(tmp_path):
    run(tmp_path / "fixed", views="fixed")
    with pytest.raises(UsageError, match="run fixed has no viewpoint network: its views are fixed"):
        build_recogniser(config(views="transferred", views_from=tmp_path / "fixed"), CLASSES)
    run(tmp_path / "five", views="learned-direct", num_views=5)
    with pytest.raises(UsageError, match="run five chooses 5 views, not 4") as caught:
        build_recogniser(config(views="transferred", views_from=tmp_path / "five"), CLASSES)
    assert "--num-views 5" in caught.value.hint
    with pytest.raises(DataError, match="is not the folder of a run"):
        build_recogniser(config(views="transferred", views_from=tmp_path), CLASSES)
    (tmp_path / "five" / "best.safetensors").unlink()
    with pytest.raises(DataError, match="run five has no weights yet"):
        build_recogniser(config(views="transferred", views_from=tmp_path / "five"), CLASSES)
    (tmp_path / "five" / "last.safetensors").write_bytes(b"no weights")
    with pytest.raises(DataError, match=r"can't read the run in .*five"):
        build_recogniser(config(views="transferred", views_from=tmp_path / "five"), CLASSES)


@pytest.mark.parametrize("backbone", ["tiny", "squeezenet1_1"])
@pytest.mark.parametrize("place", ["", "last.safetensors"])
def test_backbone_of_a_run_is_taken_with_its_scaling_of_pictures(backbone, place, tmp_path):
    theirs = run(tmp_path / "one", backbone=backbone)
    save(tmp_path / "one", theirs, "last")
    ours, _ = build_backbone(backbone, str(tmp_path / "one" / place))
    pictures = torch.rand(2, 3, 32, 32)
    ours = ours.eval().to(memory_format=torch.channels_last)
    assert torch.equal(ours(pictures), theirs.network.backbone(pictures))
    # a run that was itself begun so is loaded without the first one
    again, _ = build_backbone(backbone, "gone", read=False)
    again.load_state_dict(ours.state_dict())
    assert torch.equal(again.eval().to(memory_format=torch.channels_last)(pictures), ours(pictures))


def test_run_of_version_0_1_loads_with_its_classifier_and_the_scaling_of_its_settings(tmp_path, calls, batch):
    """MVCNN's layers lay one level higher, and scaling was not written down."""
    theirs = run(tmp_path / "one", backbone="squeezenet1_1", image_size=32)
    theirs.network.backbone.mean.fill_(PLAIN_MEAN[0])
    theirs.network.backbone.deviation.fill_(0.4)
    state = {
        name.replace("network.head.", "network."): value.contiguous()
        for name, value in theirs.state_dict().items()
        if not name.endswith((".mean", ".deviation"))
    }
    assert "network.classifier.weight" in state
    again = build_recogniser(theirs.config, CLASSES, read_weights=False).eval()
    again.load_state_dict(state)
    assert torch.equal(again(batch, look(theirs.config)).logits, theirs(batch, look(theirs.config)).logits)
    save_file(state, tmp_path / "one" / "best.safetensors")
    backbone, _ = build_backbone("squeezenet1_1", str(tmp_path / "one"))
    torch.testing.assert_close(backbone.mean, theirs.network.backbone.mean)


def test_backbone_of_another_kind_is_refused_in_one_sentence(tmp_path):
    run(tmp_path / "one", backbone="tiny")
    with pytest.raises(DataError, match="run one has the backbone tiny, not resnet18") as caught:
        build_backbone("resnet18", str(tmp_path / "one"))
    assert caught.value.hint == "add --backbone tiny"
    with pytest.raises(DataError, match="no weight file"):
        build_backbone("tiny", str(tmp_path / "none"))
