"""The whole chain, with a stand-in for the renderer, and once with the real one."""

from __future__ import annotations

import pytest
import torch
from tetrahedra import CLASSES, config, look, tetrahedron
from torch import nn

from mvtn_cli.core.networks import build_recogniser
from mvtn_cli.core.render import pack


@pytest.mark.parametrize("views", ["learned-direct", "learned-circular", "learned-spherical"])
def test_loss_reaches_the_viewpoint_network_through_the_pictures(views, calls, batch):
    settings = config(views=views, gradient="fd", fd_step=1.5)
    model = build_recogniser(settings, CLASSES)
    before = [weight.clone() for weight in model.viewpoint_parameters()]
    output = model(batch, look(settings))
    assert output.logits.shape == (3, CLASSES) and output.images.shape == (3, 4, 3, 16, 16)
    nn.functional.cross_entropy(output.logits, batch.labels).backward()
    torch.optim.AdamW(model.viewpoint_parameters(), 1e-2).step()
    assert any((a - b).abs().max() > 1e-4 for a, b in zip(before, model.viewpoint_parameters(), strict=True))
    assert (calls[0].gradient, calls[0].fd_step_deg) == ("fd", 1.5)


def test_real_renderer_carries_the_gradient(batch):
    settings = config(views="learned-spherical", image_size=12)
    model = build_recogniser(settings, CLASSES)
    output = model(batch, look(settings))
    assert output.images.min() >= 0 and output.images.max() > 0.5
    nn.functional.cross_entropy(output.logits, batch.labels).backward()
    gradient = model.selector.head[2].bias.grad
    assert torch.isfinite(gradient).all() and gradient.abs().max() > 0


def test_exploration_and_point_subset_are_for_training_alone(calls, batch):
    settings = config(views="learned-direct")
    model = build_recogniser(settings, CLASSES)

    def cameras(seed: int) -> torch.Tensor:
        generator = torch.Generator().manual_seed(seed)
        return model(batch, look(settings), explore_deg=30.0, generator=generator).cameras.azimuth_deg

    model.train()
    assert torch.equal(cameras(1), cameras(1)) and not torch.equal(cameras(1), cameras(2))
    model.eval()
    assert torch.equal(cameras(1), cameras(2))
    head = batch.with_points(batch.points[:, :16])
    assert torch.equal(model.choose_cameras(head).azimuth_deg, model.choose_cameras(batch).azimuth_deg)


def test_encoder_sees_other_points_in_each_step_of_training(batch):
    model = build_recogniser(config(views="learned-direct"), CLASSES).train()
    one, other = (model.choose_cameras(batch, generator=torch.Generator().manual_seed(s)).azimuth_deg for s in (1, 2))
    assert not torch.equal(one, other)


def test_network_starts_alike_for_every_selection_of_views_and_from_the_seed_alone():
    torch.manual_seed(1)
    fixed = build_recogniser(config(views="fixed"), CLASSES)
    drawn = torch.rand(1)
    torch.manual_seed(1)
    learned = build_recogniser(config(views="learned-spherical"), CLASSES)
    assert torch.equal(torch.rand(1), drawn)  # the caller's random state is left alone
    for one, other in zip(fixed.network.parameters(), learned.network.parameters(), strict=True):
        assert torch.equal(one, other)
    other_seed = build_recogniser(config(views="fixed", seed=1), CLASSES)
    assert not torch.equal(fixed.network.head.classifier.weight, other_seed.network.head.classifier.weight)


def test_parameters_are_each_in_one_group():
    model = build_recogniser(config(backbone_lr_scale=0.1), CLASSES)
    groups = {group["name"]: group for group in model.network_parameters()}
    assert groups["backbone"]["lr_scale"] == 0.1 and groups["head"]["lr_scale"] == 1.0
    listed = [*model.viewpoint_parameters(), *(w for g in groups.values() for w in g["params"])]
    assert len({id(w) for w in listed}) == len(listed) == len(list(model.parameters()))
    torch.optim.AdamW(list(groups.values()), 1e-3)
    assert build_recogniser(config(views="fixed"), CLASSES).viewpoint_parameters() == []


def test_frozen_backbone_stays_and_still_passes_the_gradient_to_the_cameras(calls, batch):
    settings = config(freeze_backbone=True)
    model = build_recogniser(settings, CLASSES).train()
    before = {name: value.clone() for name, value in model.network.backbone.state_dict().items()}
    assert [group["name"] for group in model.network_parameters()] == ["head"]
    model(batch, look(settings)).logits.square().sum().backward()
    assert model.selector.head[2].weight.grad.abs().max() > 0
    for name, value in model.network.backbone.state_dict().items():  # BatchNorm statistics too
        assert torch.equal(value, before[name])


def test_checkpoint_restores_every_number(calls, batch):
    settings = config(views="learned-direct")
    model = build_recogniser(settings, CLASSES).train()
    model(batch, look(settings))
    again = build_recogniser(settings.model_copy(update={"seed": 7}), CLASSES, read_weights=False)
    again.load_state_dict(model.state_dict())
    one, other = model.eval()(batch, look(settings)), again.eval()(batch, look(settings))
    assert torch.equal(one.logits, other.logits)
    assert torch.equal(one.cameras.azimuth_deg, other.cameras.azimuth_deg)


def test_frozen_and_plain_networks_of_one_shape_and_one_view_train(calls):
    settings = config(num_views=1, views="learned-direct")
    single = pack([tetrahedron(1.0)])
    output = build_recogniser(settings, CLASSES).train()(single, look(settings, 1))
    assert torch.isfinite(output.logits).all() and output.descriptor.shape == (1, 1024)
