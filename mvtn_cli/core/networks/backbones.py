"""Networks that turn a picture into a feature vector: a small one of our own, and torchvision's."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any
from urllib.parse import urlparse

import torch
from torch import Tensor, nn
from torch.nn import functional

from mvtn_cli.core.networks.run_files import is_run, read_run
from mvtn_cli.core.networks.weights import load_strictly, read_weights
from mvtn_cli.errors import DataError, MvtnError, UsageError, choose_error

if TYPE_CHECKING:
    from torchvision.models import WeightsEnum

IMAGENET_MEAN, IMAGENET_DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
# pictures in [0, 1] brought to about unit deviation, for networks that start from nothing
PLAIN_MEAN, PLAIN_DEVIATION = (0.5, 0.5, 0.5), (0.4, 0.4, 0.4)

SMALLEST = {"alexnet": 64, "inception_v3": 75}  # pixels; below it a layer has no output left
SMALLEST_OTHER = 32
AUXILIARY = ("aux1.", "aux2.", "AuxLogits.")  # training heads of GoogLeNet and Inception


def backbone_names() -> list[str]:
    """All names that `build_backbone` takes."""
    models = _torchvision_models()
    return ["tiny", *models.list_models(module=models)]


def build_backbone(name: str, weights: str = "none", *, read: bool = True) -> tuple[nn.Module, int]:
    """Build a network without its classifier.

    Args:
        name: "tiny" or a torchvision classifier, e.g. "resnet18".
        weights: "none" (random, from torch's generator), "imagenet" (torchvision's, downloaded once), a file:
            a torchvision state dict, with or without its head; or the folder of a run, whose backbone is
            taken. Pictures are normalised as in ImageNet for the first two of these, as in that run for the
            last.
        read: False leaves the numbers random, for a caller who loads a whole checkpoint afterwards.

    Returns:
        A module that maps (N, 3, H, W) pictures in [0, 1] to (N, D) features, and D.

    Raises:
        UsageError: Unknown name, or "imagenet" for the network of our own.
        DataError: The file or run can't be read or does not fit.
        MvtnError: The download failed.
    """
    if name == "tiny":
        return _tiny(weights, read)
    if name not in (names := backbone_names()):
        raise choose_error("backbone", name, names)
    body, head_name, dimension = torchvision_body(name, pretrained=weights != "none")
    backbone = Pictures(body, name, normalise=weights != "none")
    if weights == "none" or not read:
        return backbone, dimension
    if weights != "imagenet" and is_run(Path(weights)):
        _take_from_run(backbone, name, Path(weights))
    else:
        state = _imagenet(name) if weights == "imagenet" else read_weights(Path(weights))
        source = "torchvision" if weights == "imagenet" else weights
        load_strictly(body, state, ignored=(f"{head_name}.", *AUXILIARY), network=name, source=source)
    return backbone, dimension


def _take_from_run(backbone: nn.Module, name: str, place: Path) -> None:
    """Load the backbone of a run, with its scaling of pictures."""
    run = read_run(place)
    theirs = str(run.settings.get("backbone", "tiny"))
    if theirs != name:
        raise DataError(
            f"run {run.folder.name} has the backbone {theirs}, not {name}",
            hint=f"add --backbone {theirs}",
            code="weights.mismatch",
        )
    state = run.part("network.backbone.")
    if isinstance(backbone, Pictures):
        # version 0.1 did not write the scaling down: it followed from the settings
        plain = Pictures(nn.Identity(), name, normalise=run.settings.get("weights", "none") != "none")
        state = {"mean": plain.mean, "deviation": plain.deviation, **state}
    load_strictly(backbone, state, network=name, source=str(run.folder))


def _tiny(weights: str, read: bool) -> tuple[nn.Module, int]:
    if weights == "imagenet":
        raise UsageError(
            "there are no ImageNet weights for the backbone 'tiny'",
            hint="--weights none, or a torchvision backbone as --backbone resnet18",
            code="weights.none-for-backbone",
        )
    network = Tiny()
    if weights != "none" and read:
        if is_run(Path(weights)):
            _take_from_run(network, "tiny", Path(weights))
        else:
            load_strictly(network, read_weights(Path(weights)), network="tiny", source=weights)
    return network, Tiny.DIMENSION


class Tiny(nn.Module):
    """Three convolutions, for pictures of about 64..128 pixels on a CPU; 24,000 parameters, D = 1024.

    5x5x16, 3x3x32 and 3x3x64, each of stride 2 with BatchNorm and ReLU, then an average over a 4x4 grid,
    which keeps where in the picture a feature is.
    """

    GRID = 4
    DIMENSION = 64 * GRID**2

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(_block(3, 16, 5), _block(16, 32, 3), _block(32, 64, 3))

    def forward(self, pictures: Tensor) -> Tensor:
        centred = (pictures - PLAIN_MEAN[0]) / PLAIN_DEVIATION[0]
        return functional.adaptive_avg_pool2d(self.layers(centred), self.GRID).flatten(1)


def _block(inputs: int, outputs: int, size: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride=2, padding=size // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class Pictures(nn.Module):
    """A torchvision body together with the scaling of pictures that it was trained with.

    Pictures of a size that the body can't take (below its smallest, or other than the one of a vision
    transformer) are resized.
    """

    mean: Tensor
    deviation: Tensor

    def __init__(self, body: nn.Module, name: str, *, normalise: bool) -> None:
        super().__init__()
        self.body = body
        self.fixed_size = 224 if name == "maxvit_t" else getattr(body, "image_size", None)
        self.smallest = SMALLEST.get(name, SMALLEST_OTHER)
        mean, deviation = (IMAGENET_MEAN, IMAGENET_DEVIATION) if normalise else (PLAIN_MEAN, PLAIN_DEVIATION)
        self.register_buffer("mean", torch.tensor(mean)[:, None, None])
        self.register_buffer("deviation", torch.tensor(deviation)[:, None, None])

    def forward(self, pictures: Tensor) -> Tensor:
        height, width = pictures.shape[-2:]
        wanted = self.fixed_size or max(self.smallest, height), self.fixed_size or max(self.smallest, width)
        if wanted != (height, width):
            pictures = functional.interpolate(pictures, wanted, mode="bilinear", align_corners=False, antialias=True)
        features: Tensor = self.body((pictures - self.mean) / self.deviation)
        return features.flatten(1)

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *arguments: Any) -> None:
        # runs of version 0.1 did not write the scaling down: it is as this network was built
        for name in ("mean", "deviation"):
            state_dict.setdefault(prefix + name, getattr(self, name))
        super()._load_from_state_dict(state_dict, prefix, *arguments)


def torchvision_body(name: str, *, pretrained: bool = False) -> tuple[nn.Module, str, int]:
    """A torchvision classifier whose last layer is replaced by the identity.

    Args:
        name: As in `torchvision.models`.
        pretrained: Whether ImageNet weights will be loaded: two networks then scale their input once more.

    Returns:
        The network, the name of the layer that was taken off, and the number of features it now gives.
    """
    options: dict[str, Any] = {}
    if name in ("googlenet", "inception_v3"):
        options = {"aux_logits": False, "init_weights": False, "transform_input": pretrained}
    network: nn.Module = _torchvision_models().get_model(name, weights=None, **options)
    # all of them register the head last; squeezenets have a 1x1 convolution there
    head_name, head = [
        (path, layer) for path, layer in network.named_modules() if isinstance(layer, nn.Linear | nn.Conv2d)
    ][-1]
    dimension = head.in_features if isinstance(head, nn.Linear) else head.in_channels
    network.set_submodule(head_name, nn.Identity())
    return network, head_name, int(dimension)


def _imagenet(name: str) -> dict[str, Tensor]:
    """Torchvision's ImageNet weights of a network, downloaded once."""
    chosen = imagenet_weights(name)
    try:
        return dict(chosen.get_state_dict(progress=False, check_hash=True, weights_only=True))
    except (OSError, RuntimeError) as error:  # URLError is an OSError; a wrong hash a RuntimeError
        folder = Path(torch.hub.get_dir()) / "checkpoints"
        file_name = Path(urlparse(chosen.url).path).name
        raise MvtnError(
            f"can't download the ImageNet weights of {name}: {error}",
            hint=f"fetch {chosen.url} elsewhere and put it into {folder}, or name it: --weights {file_name}",
            code="weights.download",
        ) from error


def imagenet_weights(name: str) -> WeightsEnum:
    """The ImageNet weights of a network for pictures of its usual size (others need 384..518 pixels)."""
    known = _torchvision_models().get_model_weights(name).__members__
    chosen: WeightsEnum = known.get("IMAGENET1K_V1") or known["IMAGENET1K_SWAG_LINEAR_V1"]
    return chosen


def _torchvision_models() -> ModuleType:
    """Torchvision's networks. Importing them takes a second, which the network of our own need not wait for."""
    from torchvision import models

    return models
