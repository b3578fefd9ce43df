"""Mixed precision (T25): networks in bfloat16, cameras and pictures as they were."""

from __future__ import annotations

import pytest
import torch
from tetrahedra import CLASSES, config, look
from torch.nn import functional

from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.training.device import use_mixed
from mvtn_cli.core.training.learner import Learner
from mvtn_cli.network_config import NETWORKS, POINT_NETWORKS


def step(settings, batch, kind: str, *, mixed: bool):
    torch.manual_seed(0)
    model = Learner(build_recogniser(settings, CLASSES), 0.1, mixed=mixed).train()
    loss, logits, images = model(batch, look(settings, kind=kind), 5.0, torch.Generator().manual_seed(0))
    loss.backward()
    return model, loss.detach(), logits, images


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("kind", ["mesh", "points"])
def test_pictures_are_the_same_bytes_and_the_loss_nearly(network, kind, batch):
    views = "fixed" if network in POINT_NETWORKS else "learned-spherical"
    settings = config(network=network, views=views, graph_width=16)
    (_, loss, logits, images), (model, cast_loss, cast_logits, cast_images) = (
        step(settings, batch, kind, mixed=mixed) for mixed in (False, True)
    )
    assert torch.equal(images, cast_images) and cast_images.dtype == torch.float32
    assert abs(cast_loss - loss) < 0.1 * loss
    assert not torch.equal(logits, cast_logits.float())
    for weight in model.parameters():
        assert weight.grad is None or (weight.grad.dtype == torch.float32 and torch.isfinite(weight.grad).all())


def test_the_gradient_of_the_views_keeps_its_direction(batch):
    settings = config(views="learned-direct", image_size=32)
    gradients = []
    for mixed in (False, True):
        model, *_ = step(settings, batch, "mesh", mixed=mixed)
        gradients.append(torch.cat([p.grad.flatten() for p in model.recogniser.viewpoint_parameters()]))
    assert functional.cosine_similarity(*gradients, dim=0) > 0.9


def test_automatic_precision_is_float32_on_a_cpu():
    cpu = torch.device("cpu")
    assert not use_mixed("auto", cpu) and not use_mixed("float32", cpu) and use_mixed("bf16", cpu)
