"""BatchNorm has to fit the pictures that a network is judged by, not those that it was trained on."""

from __future__ import annotations

import torch
from torch.nn.modules.batchnorm import _BatchNorm

from mvtn_cli.core.networks.recogniser import Recogniser, build_recogniser
from mvtn_cli.core.render import Look
from mvtn_cli.core.training import judge, loop
from mvtn_cli.core.training.settle import settle_batch_norm
from mvtn_cli.core.training.shapes import load_batch


def norms(model: Recogniser) -> list[_BatchNorm]:
    return [layer for layer in model.modules() if isinstance(layer, _BatchNorm)]


def spoilt(config, shapes) -> Recogniser:
    model = build_recogniser(config, len(shapes.classes))
    for layer in norms(model):
        layer.running_mean.fill_(3.0)
        layer.running_var.fill_(0.01)
    return model.train()


def test_settled_statistics_are_those_of_evaluation_pictures(settings, boxes):
    config, shapes = settings(), boxes
    model = spoilt(config, shapes)
    chosen = shapes.split("train")
    settle_batch_norm(model, shapes, chosen, config)
    batch, kind = load_batch(shapes, chosen, config.render)
    first = norms(model.network)[0]
    seen: list[torch.Tensor] = []
    hook = first.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    with torch.no_grad():
        model.eval()(batch, Look.evaluation(config, len(batch), kind))
    hook.remove()
    # The mean over batches of equal size is the mean over all pictures.
    assert len(chosen) % config.batch_size == 0
    torch.testing.assert_close(first.running_mean, seen[0].mean((0, 2, 3)), atol=1e-4, rtol=1e-4)


def test_settling_touches_no_weight_and_leaves_the_mode_and_the_momentum(settings, boxes):
    config, shapes = settings(), boxes
    model = spoilt(config, shapes)
    before = [weight.clone() for weight in model.parameters()]
    settle_batch_norm(model, shapes, shapes.split("train"), config)
    assert model.training
    assert all(layer.momentum == 0.1 and layer.training for layer in norms(model))
    assert all(torch.equal(a, b) for a, b in zip(before, model.parameters(), strict=True))
    assert not any((layer.running_mean == 3.0).any() for layer in norms(model))


def test_a_frozen_backbone_keeps_its_statistics(settings, boxes):
    config, shapes = settings(freeze_backbone=True), boxes
    model = spoilt(config, shapes)
    settle_batch_norm(model, shapes, shapes.split("train"), config)
    assert all((layer.running_mean == 3.0).all() for layer in norms(model.network.backbone))


def test_the_training_loop_settles_before_it_judges(settings, boxes, quiet, monkeypatch):
    order: list[str] = []
    real = judge.judge_epoch
    monkeypatch.setattr(loop, "settle_batch_norm", lambda *_, **__: order.append("settle"))
    monkeypatch.setattr(judge, "judge_epoch", lambda *a, **k: (order.append("judge"), real(*a, **k))[1])
    loop.train(settings(), boxes, quiet)
    assert order == ["settle", "judge"] * 2
