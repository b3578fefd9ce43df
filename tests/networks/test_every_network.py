"""Every network with every selection of views that it admits: the gradient's way, two steps, a round trip."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from tetrahedra import CLASSES, config, look, tetrahedron
from torch.nn import functional

from mvtn_cli.core.networks import Recogniser, build_recogniser
from mvtn_cli.core.render import pack
from mvtn_cli.errors import UsageError
from mvtn_cli.network_config import NETWORKS, POINT_NETWORKS
from mvtn_cli.shared_config import SELECTIONS

LEARNED = [views for views in SELECTIONS if views.startswith("learned")]
OF_VIEWS = [network for network in NETWORKS if network not in POINT_NETWORKS]
EXTRAS = [{}, {"fuse": True}, {"first_stage_epochs": 1}, {"learn_distance": 1.4, "learn_light": True}]


def step(model: Recogniser, batch, kind: str, seed: int) -> None:
    torch.manual_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    output = model.train()(batch, look(model.config, kind=kind), explore_deg=5.0, generator=generator)
    groups = [*model.network_parameters(), {"params": model.viewpoint_parameters()}]
    optimiser = torch.optim.AdamW([group for group in groups if group["params"]], 1e-2)
    model.loss(output, batch.labels, 0.1).backward()
    optimiser.step()


def admitted() -> list[tuple[str, str]]:
    plain = ("fixed", "jittered", "random")
    pairs = [(network, views) for network in NETWORKS for views in SELECTIONS if views != "transferred"]
    return [(network, views) for network, views in pairs if network not in POINT_NETWORKS or views in plain]


@pytest.mark.parametrize(("network", "views"), admitted())
@pytest.mark.parametrize("kind", ["mesh", "points"])
def test_two_steps_then_a_round_trip_give_the_same_logits_bit_for_bit(network, views, kind, batch):
    """With the real renderer."""
    settings = config(network=network, views=views, image_size=12, graph_width=16)
    model = build_recogniser(settings, CLASSES)
    before = {name: weight.clone() for name, weight in model.named_parameters()}
    for seed in range(2):
        step(model, batch, kind, seed)
    changed = {n.split(".")[0] for n, w in model.named_parameters() if not torch.equal(w, before[n])}
    assert changed == ({"network", "selector"} if views in LEARNED else {"network"})
    again = build_recogniser(settings.model_copy(update={"seed": 5}), CLASSES, read_weights=False)
    again.load_state_dict(model.state_dict())
    one, other = (m.eval()(batch, look(settings, kind=kind)) for m in (model, again))
    assert torch.equal(one.logits, other.logits) and torch.equal(one.descriptor, other.descriptor)
    assert one.logits.shape == (3, CLASSES) and torch.isfinite(one.logits).all()


@pytest.mark.parametrize("network", OF_VIEWS)
@pytest.mark.parametrize("views", LEARNED)
@pytest.mark.parametrize("extra", EXTRAS)
def test_gradient_reaches_the_angles_through_the_pictures(network, views, extra, calls, batch):
    settings = config(network=network, views=views, graph_width=16, **extra)
    model = build_recogniser(settings, CLASSES).eval()
    placed = model.place(batch, generator=torch.Generator().manual_seed(0))
    for angle in (placed.cameras.azimuth_deg, placed.cameras.elevation_deg, placed.cameras.distance):
        if angle.requires_grad:
            angle.retain_grad()
    model.loss(model.recognise(batch, look(settings), placed), batch.labels).backward()
    assert (placed.cameras.azimuth_deg.grad.abs() > 0).any(dim=0).all()
    assert (placed.cameras.elevation_deg.grad.abs() > 0).any(dim=0).all()
    assert "learn_distance" not in extra or placed.cameras.distance.grad.abs().max() > 0
    assert model.selector.head[-1].bias.grad.abs().max() > 0


def test_light_is_learned_from_real_pictures(batch):
    """The gradient of its offset against the difference of two losses; the start is the headlight."""
    settings = config(views="learned-circular", learn_light=True, image_size=24, num_views=2)
    model = build_recogniser(settings, CLASSES).eval()
    plain = build_recogniser(settings.model_copy(update={"learn_light": False}), CLASSES).eval()
    lit, headlight = (m(batch, look(settings)) for m in (model, plain))
    torch.testing.assert_close(lit.images, headlight.images, atol=1e-4, rtol=0)
    bias = model.selector.scene.layer.bias
    torch.nn.init.constant_(bias, 0.3)
    weight = torch.randn(lit.images.shape, generator=torch.Generator().manual_seed(0))

    def loss() -> torch.Tensor:
        return (model(batch, look(settings)).images * weight).sum()

    loss().backward()
    assert bias.grad.abs().min() > 0
    with torch.no_grad():
        bias[2] += 0.01
        above = loss()
        bias[2] -= 0.02
        slope = (above - loss()) / 0.02
    assert bias.grad[2].item() == pytest.approx(slope.item(), rel=0.03)


@pytest.mark.parametrize("network", OF_VIEWS)
@pytest.mark.parametrize("extra", EXTRAS[:3])
def test_tiny_set_is_learned_by_heart(network, extra):
    """Six tetrahedra, regular or flat, with the real renderer."""
    batch = pack([tetrahedron(s) for s in (1.0, 0.3, 0.95, 0.35, 0.9, 0.4)], labels=[0, 1] * 3)
    settings = config(network=network, views="fixed", graph_width=32, **extra)
    model = build_recogniser(settings, 2).train()
    optimiser = torch.optim.AdamW(model.network_parameters(), 3e-3)
    for number in range(40):
        model.begin_stage(model.stages[0] if number < 10 else "shapes")
        optimiser.zero_grad()
        loss = model.loss(model(batch, look(settings, 6)), batch.labels)
        loss.backward()
        optimiser.step()
    right = [(model(batch, look(settings, 6)).logits.argmax(1) == batch.labels).float().mean() for _ in range(3)]
    assert min(right) == 1 and loss < 0.4


@pytest.mark.parametrize("network", OF_VIEWS)
def test_first_stage_classifies_each_picture_and_leaves_cameras_and_head_alone(network, calls, batch):
    settings = config(network=network, views="learned-circular", first_stage_epochs=3, graph_width=16)
    model = build_recogniser(settings, CLASSES).train()
    assert model.stages == ("views", "shapes") and model.stage == "shapes"
    model.begin_stage("views")
    output = model(batch, look(settings), explore_deg=5.0)
    answers = output.extra["each view"]
    expected = functional.cross_entropy(answers.flatten(0, 1), batch.labels.repeat_interleave(4))
    torch.testing.assert_close(model.loss(output, batch.labels), expected)
    torch.testing.assert_close(output.logits, answers.log_softmax(-1).mean(1))
    model.loss(output, batch.labels).backward()
    taught = {name.split(".")[1] for name, weight in model.named_parameters() if weight.grad is not None}
    assert taught == {"backbone", "view_classifier"}
    model.begin_stage("shapes")
    model.zero_grad()
    model.loss(model(batch, look(settings)), batch.labels).backward()
    taught = {name.split(".")[1] for name, weight in model.named_parameters() if weight.grad is not None}
    assert taught >= {"backbone", "head"} and "view_classifier" not in taught


def test_one_stage_is_the_rule_and_no_other_can_be_entered():
    model = build_recogniser(config(), CLASSES)
    assert model.stages == ("shapes",)
    with pytest.raises(ValueError, match="stage must be one of"):
        model.begin_stage("views")


@pytest.mark.parametrize("network", OF_VIEWS)
def test_fused_logits_are_those_of_views_and_points_together_and_both_learn(network, calls, batch):
    settings = config(network=network, views="fixed", fuse=True, graph_width=16)
    fused = build_recogniser(settings, CLASSES).eval()
    plain = build_recogniser(settings.model_copy(update={"fuse": False}), CLASSES).eval()
    output, views = fused(batch, look(settings)), plain(batch, look(settings))
    branch = fused.network.points
    features = branch.encoder(batch.points[:, :16])
    torch.testing.assert_close(output.logits, views.logits + branch.classifier(features))
    torch.testing.assert_close(output.descriptor, torch.cat([views.descriptor, features], dim=1))
    terms = fused.losses(output, batch.labels)
    assert ("fused" in terms) == (network == "rotationnet")
    sum(terms.values()).backward()
    assert branch.classifier.weight.grad.abs().max() > 0
    assert any(weight.grad.abs().max() > 0 for weight in fused.network.backbone.parameters())


def test_rotationnet_learns_the_same_from_its_views_with_and_without_points(calls, batch):
    gradients = []
    for fuse in (True, False):
        settings = config(network="rotationnet", views="fixed", fuse=fuse)
        model = build_recogniser(settings, CLASSES).eval()
        model.loss(model(batch, look(settings)), batch.labels).backward()
        gradients.append(model.network.head.classifier.weight.grad)
    assert torch.equal(*gradients)


@pytest.mark.parametrize("network", OF_VIEWS)
@pytest.mark.parametrize("extra", EXTRAS[:3])
def test_backbone_and_shared_layers_start_alike_whatever_else_there_is(network, extra):
    plain = build_recogniser(config(network=network, graph_width=16), CLASSES).network
    other = build_recogniser(config(network=network, graph_width=16, views="learned-direct", **extra), CLASSES).network
    for name, weight in plain.named_parameters():
        assert torch.equal(weight, other.get_parameter(name)), name


def test_point_networks_take_no_pictures_and_see_what_the_settings_say(calls, batch):
    settings = config(network="pointnet", views="fixed")
    model = build_recogniser(settings, CLASSES)
    output = model.eval()(batch, look(settings))
    assert not calls and not model.uses_views and output.images.shape == (3, 0, 3, 16, 16)
    head = batch.with_points(batch.points[:, :16])
    assert torch.equal(model(head, look(settings)).logits, output.logits)
    assert [group["name"] for group in model.network_parameters()] == ["head"]
    drawn = [model.train()._points(batch, torch.Generator().manual_seed(seed)) for seed in (1, 1, 2)]
    assert torch.equal(drawn[0], drawn[1]) and not torch.equal(drawn[0], drawn[2])


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"network": "mvcn"}, "unknown network 'mvcn'; did you mean 'mvcnn'"),
        ({"network": "pointnet", "views": "learned-direct"}, "looks at points alone"),
        ({"network": "dgcnn", "views": "fixed", "fuse": True}, "no views to fuse"),
        ({"network": "viewgcn", "num_views": 3}, "at least 4 views"),
    ],
)
def test_combinations_that_make_no_sense_are_refused(more: dict[str, Any], said: str):
    with pytest.raises(UsageError, match=said):
        build_recogniser(config(**more), CLASSES)


@pytest.mark.parametrize(
    ("more", "count", "layout"),
    [
        ({"views": "learned-circular", "num_views": 12}, 12, "circular"),
        ({"views": "fixed", "layout": "dodecahedral", "num_views": 20}, 60, "dodecahedral"),
        ({"views": "jittered", "num_views": 6}, 6, "spherical"),
        ({"views": "learned-random", "num_views": 6}, 1, None),
        ({"views": "fixed", "num_views": 5}, 1, "spherical"),
    ],
)
def test_rotationnet_reports_its_candidates_and_warns_where_there_is_but_one(more, count, layout):
    model = build_recogniser(config(network="rotationnet", **more), CLASSES)
    facts = model.facts()
    assert facts["network"] == "rotationnet" and facts["candidates"] == {"count": count, "layout": layout}
    assert facts["parameters"]["classifier"] == sum(weight.numel() for weight in model.network.parameters())
    assert bool(model.warnings()) == (count == 1)
    assert not build_recogniser(config(), CLASSES).warnings()
    assert not build_recogniser(config(network="rotationnet", num_views=1), CLASSES).warnings()
