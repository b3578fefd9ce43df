"""Backbones: same as torchvision's, and weight files that fit or are told why not."""

from __future__ import annotations

import re
import urllib.error
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import nn
from torchvision import models

from mvtn_cli.core.networks import backbone_names, build_backbone
from mvtn_cli.core.networks.backbones import (
    AUXILIARY,
    IMAGENET_DEVIATION,
    IMAGENET_MEAN,
    Tiny,
    imagenet_weights,
    torchvision_body,
)
from mvtn_cli.core.networks.weights import SHOWN, load_strictly, read_weights
from mvtn_cli.errors import DataError, MvtnError, UsageError

SMALL = [
    "resnet18",
    "mobilenet_v2",
    "mobilenet_v3_small",
    "squeezenet1_1",
    "mnasnet0_5",
    "googlenet",
    "densenet121",
    "regnet_y_400mf",
]
HEADS = {"resnet18": "fc", "mobilenet_v2": "classifier.1"}


def pictures(count: int = 2, size: int = 64) -> torch.Tensor:
    return torch.rand(count, 3, size, size, generator=torch.Generator().manual_seed(0))


def normalised(images: torch.Tensor) -> torch.Tensor:
    mean, deviation = (torch.tensor(x)[:, None, None] for x in (IMAGENET_MEAN, IMAGENET_DEVIATION))
    return (images - mean) / deviation


def stirred(name: str) -> nn.Module:
    """A torchvision network whose BatchNorm statistics are not the ones that it is made with."""
    torch.manual_seed(0)
    network = models.get_model(name, weights=None).train()
    with torch.no_grad():
        network(torch.rand(4, 3, 64, 64))
    return network.eval()


@pytest.mark.parametrize("name", ["resnet18", "mobilenet_v2"])
@pytest.mark.parametrize("suffix", [".safetensors", ".pth"])
def test_backbone_with_its_head_again_is_torchvisions_network(name, suffix, tmp_path):
    whole, path = stirred(name), tmp_path / f"weights{suffix}"
    if suffix == ".pth":
        torch.save({"state_dict": {f"module.{k}": v for k, v in whole.state_dict().items()}}, path)
    else:
        save_file(whole.state_dict(), path)
    backbone, dimension = build_backbone(name, str(path))
    features = backbone.eval()(pictures())
    assert features.shape == (2, dimension)
    head = whole.get_submodule(HEADS[name])
    torch.testing.assert_close(head(features), whole(normalised(pictures())))


@pytest.mark.parametrize("name", SMALL)
@torch.no_grad()
def test_body_of_every_family_is_all_of_torchvisions_network_but_its_head(name):
    body, head_name, _ = torchvision_body(name)
    whole = models.get_model(name, weights=None, **({"init_weights": False} if name == "googlenet" else {})).eval()
    state = whole.state_dict()
    load_strictly(body, state, ignored=(f"{head_name}.", *AUXILIARY), network=name, source="torchvision")
    body.set_submodule(head_name, whole.get_submodule(head_name))
    assert torch.equal(body.eval()(pictures()), whole(pictures()))


@pytest.mark.parametrize("name", SMALL)
def test_features_have_the_announced_size_for_small_pictures(name):
    backbone, dimension = build_backbone(name)
    assert backbone.eval()(pictures(1, 32)).shape == (1, dimension)


def test_every_family_of_torchvision_gives_up_its_head_and_takes_pictures_of_64_pixels():
    """The smallest of each family, without numbers (device "meta")."""
    smallest: dict[str, str] = {}
    for name in backbone_names()[1:]:
        family = re.match(r"(efficientnet_v2|swin_v2|wide_resnet|[a-z]+)", name).group(1)
        smallest.setdefault(family, name)
    del smallest["regnet"]  # can't be built without numbers
    smallest |= {"vgg": "vgg11", "swin": "swin_t", "vit": "vit_b_32", "convnext": "convnext_tiny"}
    assert len(smallest) > 15
    for name in smallest.values():
        with torch.device("meta"):
            backbone, dimension = build_backbone(name)
            assert backbone.eval()(torch.zeros(1, 3, 64, 64)).shape == (1, dimension), name


def test_every_torchvision_classifier_has_imagenet_weights_for_its_usual_size():
    for name in backbone_names()[1:]:
        assert imagenet_weights(name).url.startswith("https://"), name
    assert backbone_names()[0] == "tiny"


def test_tiny_takes_pictures_of_any_size_and_passes_their_gradient():
    backbone, dimension = build_backbone("tiny")
    for size in (8, 33, 64, 112):
        images = pictures(2, size).requires_grad_()
        features = backbone(images)
        features.square().sum().backward()
        assert features.shape == (2, dimension) == (2, Tiny.DIMENSION)
        assert torch.isfinite(images.grad).all() and images.grad.abs().max() > 0


def test_unknown_backbone_is_told_with_the_nearest_name():
    with pytest.raises(UsageError, match="unknown backbone 'resnet81'; did you mean 'resnet18'"):
        build_backbone("resnet81")
    with pytest.raises(UsageError, match="no ImageNet weights for the backbone 'tiny'"):
        build_backbone("tiny", "imagenet")


def test_failed_download_says_what_to_fetch_and_where_to_put_it(monkeypatch):
    def unreachable(*_, **__):
        raise urllib.error.URLError("no route to host")

    monkeypatch.setattr("torch.hub.load_state_dict_from_url", unreachable)
    monkeypatch.setattr("torchvision.models._api.load_state_dict_from_url", unreachable)
    with pytest.raises(MvtnError, match=r"ImageNet weights of resnet18.*no route to host") as caught:
        build_backbone("resnet18", "imagenet")
    assert "https://download.pytorch.org/models/resnet18" in caught.value.hint
    assert "--weights resnet18" in caught.value.hint
    build_backbone("resnet18", "imagenet", read=False)  # a checkpoint comes next: nothing to download


def test_real_mobilenet_features_load_strictly_and_are_used(real_data: Path):
    path = real_data / "weights" / "mobilenet_v2_features.safetensors"
    backbone, dimension = build_backbone("mobilenet_v2", str(path))
    stored = load_file(path)
    assert dimension == 1280 and len(stored) == len(backbone.body.state_dict()) == 312
    assert all(torch.equal(value, stored[name]) for name, value in backbone.body.state_dict().items())
    reference = models.mobilenet_v2(weights=None).eval()
    reference.features.load_state_dict({name.removeprefix("features."): v for name, v in stored.items()})
    expected = reference.features(normalised(pictures())).mean((2, 3))
    torch.testing.assert_close(backbone.eval()(pictures()), expected, rtol=1e-4, atol=1e-5)


def test_truncated_wrong_and_missing_files_are_told_apart(tmp_path):
    whole = tmp_path / "whole.safetensors"
    save_file({"a": torch.zeros(1000)}, whole)
    cut = tmp_path / "cut.safetensors"
    cut.write_bytes(whole.read_bytes()[:2000])
    torch.save({"a": torch.zeros(1000)}, tmp_path / "whole.pth")
    cut_pickle = tmp_path / "cut.pth"
    cut_pickle.write_bytes((tmp_path / "whole.pth").read_bytes()[:700])
    text = tmp_path / "text.pth"
    text.write_text("<!DOCTYPE html>")
    for path in (cut, cut_pickle, text):
        with pytest.raises(DataError, match=f"can't read weights from .*{path.name}") as caught:
            read_weights(path)
        assert "\n" not in caught.value.message
    with pytest.raises(DataError, match="no weight file"):
        read_weights(tmp_path / "none.pth")
    torch.save([torch.zeros(1)], tmp_path / "list.pth")
    with pytest.raises(DataError, match="holds no named tensors but a list"):
        read_weights(tmp_path / "list.pth")


class Harmful:
    """Would create a file if it were unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_code_in_a_weight_file_is_not_run(tmp_path):
    touched = tmp_path / "touched"
    torch.save({"a": Harmful(touched)}, tmp_path / "harmful.pth")
    with pytest.raises(DataError, match="can't read weights"):
        read_weights(tmp_path / "harmful.pth")
    assert not touched.exists()


def test_weights_of_another_network_are_refused_with_a_short_list(tmp_path):
    path = tmp_path / "resnet34.safetensors"
    save_file(models.resnet34(weights=None).state_dict(), path)
    with pytest.raises(DataError, match="do not fit resnet18") as caught:
        build_backbone("resnet18", str(path))
    lines = caught.value.message.splitlines()
    assert len(lines) == 1 + SHOWN + 1 and "unexpected  layer1.2" in lines[1] and lines[-1].endswith("more")


def test_every_kind_of_difference_is_named_and_nothing_is_half_loaded():
    layer = nn.Sequential(nn.Linear(2, 3), nn.Linear(3, 1))
    before = [weight.clone() for weight in layer.parameters()]
    state = {
        "0.weight": torch.ones(3, 2),
        "0.bias": torch.ones(4),
        "1.weight": torch.ones(1, 3),
        "2.weight": torch.ones(1),
    }
    with pytest.raises(DataError) as caught:
        load_strictly(layer, state, network="layer", source="file")
    assert caught.value.message.splitlines()[1:] == [
        "  shape       0.bias is (4,), expected (3,)",
        "  missing     1.bias (1,)",
        "  unexpected  2.weight (1,)",
    ]
    assert all(torch.equal(one, other) for one, other in zip(before, layer.parameters(), strict=True))


@pytest.mark.parametrize("name", ["densenet121", "mnasnet0_5"])
def test_files_of_older_torchvision_load(name):
    """DenseNets' names had other dots; MNASNet asks for a version that a plain dict doesn't carry."""
    body, _, _ = torchvision_body(name)
    old = {
        key.replace(".norm1.", ".norm.1.").replace(".conv2.", ".conv.2.") if "denselayer" in key else key: value + 1
        for key, value in body.state_dict().items()
        if not key.endswith("num_batches_tracked")
    }
    assert name != "densenet121" or any(".norm.1." in key for key in old)
    first = next(iter(body.parameters())).clone()
    load_strictly(body, old, network=name, source="file")
    torch.testing.assert_close(next(iter(body.parameters())), first + 1)
