"""What each of several processes does in `test_processes_*.py`: trains toys together with the others, then reports.

Run as `python together.py FOLDER` with the environment that torchrun gives; writes FOLDER/rankN.json.
"""

from __future__ import annotations

import copy
import json
import math
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from conftest import make_boxes
from torch import nn

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.networks.layers import BatchNorm
from mvtn_cli.core.networks.recogniser import Recogniser, build_recogniser
from mvtn_cli.core.networks.synced import Share
from mvtn_cli.core.training import checkpoint, learner, loop, position, watch
from mvtn_cli.core.training.predict import predict
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.training.settle import settle_batch_norm
from mvtn_cli.core.training.team import Team
from mvtn_cli.errors import MvtnError

SMALL = {
    "image_size": 16, "supersample": 1, "num_views": 2, "encoder_points": 32, "batch_size": 5, "epochs": 1,
    "color": "mixed", "light": "mixed", "device": "cpu", "threads": 1,
}  # fmt: skip
# Eight boxes: batches of 5 and 3 are shared as 3 + 2 and 2 + 1, one of 1 leaves a process without a shape.
LOSSES: dict[str, dict[str, Any]] = {
    "learned": {"views": "learned-spherical", "color": "random", "light": "random", "explore": 30.0, "epochs": 10},
    "odd": {"views": "random", "network": "rotationnet", "layout": "circular", "num_views": 4, "batch_size": 3,
            "epochs": 3},
    "single": {"views": "jittered", "batch_size": 1},
    # One step alone of View-GCN's second stage: it normalises over a handful of rows, where rounding grows fast.
    "two stages": {"views": "learned-circular", "network": "viewgcn", "num_views": 4, "first_stage_epochs": 3,
                   "epochs": 4, "batch_size": 8},
}  # fmt: skip
# The same holds for these: their first gradients are compared.
GRADIENTS: dict[str, dict[str, Any]] = {
    "reference": {"views": "learned-random", "network": "viewgcn", "num_views": 4, "regressor": "reference",
                  "encoder": "pointnet", "batch_size": 8},
    "dgcnn": {"views": "fixed", "network": "dgcnn", "batch_size": 8},
    "fusion": {"views": "learned-direct", "fuse": True, "learn_light": True, "batch_size": 8},
}  # fmt: skip
# BatchNorm by itself: a layer, and the size of one picture or row.
NORMS: dict[str, tuple[nn.Module, tuple[int, ...]]] = {
    "pictures": (nn.BatchNorm2d(3), (3, 5, 4)),
    "channels last": (nn.BatchNorm2d(3), (3, 5, 4)),
    "rows": (BatchNorm(4), (6, 4)),
}
LAYOUTS = {"channels last": torch.channels_last}


def settings(runs: Path, **changed: Any) -> TrainConfig:
    return TrainConfig(**{**SMALL, "runs": runs, **changed})


def losses_of(runs: Path, name: str) -> dict[str, Any]:
    """Train a case; gives loss, right answers and shapes of each step, and the lines of metrics.jsonl."""
    steps: list[tuple[float, int, int]] = []
    add = position.Tally.add

    def noted(tally: position.Tally, *step: Any) -> None:
        steps.append(step)
        add(tally, *step)

    with replaced(position.Tally, "add", noted):
        run = loop.train(settings(runs, name=name.replace(" ", "-"), **LOSSES[name]), make_boxes(), Console(quiet=True))
    return {"steps": steps, "metrics": [{**line, "seconds": 0.0} for line in run.metrics()]}


def gradients_of(runs: Path, name: str) -> dict[str, list[float]]:
    """Gradients of the first step, by network: every hundredth number of a few millions."""
    found: dict[str, list[float]] = {}
    judge = watch.not_finite

    def noted(loss: float, optimisers: dict[str, torch.optim.Optimizer]) -> str | None:
        for network, optimiser in optimisers.items():
            grads = [p.grad.flatten() for p in learner.parameters_of(optimiser) if p.grad is not None]
            found.setdefault(network, torch.cat(grads)[::101].tolist())
        return judge(loss, optimisers)

    with replaced(watch, "not_finite", noted):
        loop.train(settings(runs, name=name, **GRADIENTS[name]), make_boxes(), Console(quiet=True))
    return found


def answers(team: Team | None) -> dict[str, Any]:
    """What an untrained network says of seven shapes, in batches of two."""
    boxes, config = make_boxes(), settings(Path("."), views="random")
    found = predict(build_recogniser(config, 4), boxes, range(7), config, batch_size=2, keep_images=5, team=team)
    assert found.images is not None
    return {
        "names": found.names,
        "logits": found.logits.tolist(),
        "azimuth": found.azimuth_deg.tolist(),
        "images": [len(found.images), int(found.images.astype(np.int64).sum())],
    }


def settled(team: Team | None) -> dict[str, list[float]]:
    """BatchNorm statistics of untrained networks, measured on seven shapes in batches of 5 and 2."""
    found = {}
    for name in ("mvcnn", "viewgcn", "dgcnn"):
        config = settings(Path("."), network=name, views="random", num_views=4)
        model = build_recogniser(config, 4)
        if team is not None:
            team.synchronise(model)
        settle_batch_norm(model, make_boxes(), range(7), config, team=team)
        found[name] = torch.cat([b.double().flatten() for n, b in model.named_buffers() if "running" in n]).tolist()
    return found


def normed(team: Team | None, name: str, shapes: int) -> dict[str, Any]:
    """A BatchNorm of three pictures or rows a shape, and what goes back through it: this process's part."""
    torch.manual_seed(7)
    layer, size = NORMS[name]
    layer = copy.deepcopy(layer)
    values, tint = 3.0 + 2.0 * torch.randn(3 * shapes, *size), torch.randn(3 * shapes, *size)
    share = Share(shapes, 0, 1)
    if team is not None:
        holder = nn.Sequential(layer)
        team.synchronise(holder)
        layer, share = holder[0], team.share(list(range(shapes)))
    part = slice(3 * share.rows.start, 3 * share.rows.stop)
    values = values[part].clone(memory_format=LAYOUTS.get(name, torch.preserve_format)).requires_grad_()
    result = layer(values)
    loss = ((result * tint[part]).sin() * (share.own > 0)).sum()
    loss.backward()
    own = 3 * share.own
    return {
        "normed": result[:own].tolist(),
        "to_input": values.grad[:own].tolist(),  # type: ignore[index]
        "to_weights": [p.grad.tolist() for p in layer.parameters()],  # type: ignore[union-attr]
        "statistics": [b.tolist() for b in layer.buffers()],
    }


@contextmanager
def replaced(owner: Any, name: str, value: Any) -> Iterator[None]:
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


def after(steps: int, act: Callable[[], Any]) -> Callable[[], bool]:
    """A question that says no, and acts the n-th time it is asked."""
    left = iter(range(steps - 1, -1, -1))
    return lambda: next(left, None) == 0 and bool(act())


def failure(work: Callable[[], Any]) -> dict[str, Any] | None:
    try:
        work()
    except MvtnError as error:
        return {"kind": type(error).__name__, "message": error.message, "code": error.code}
    return None


def spoilt(team: Team) -> Callable[..., Recogniser]:
    """Networks of which the second process has a gradient that is NaN in its second step."""

    def build(*args: Any, **kwargs: Any) -> Recogniser:
        model, count = build_recogniser(*args, **kwargs), iter(range(10**6))
        weight = list(model.network.parameters())[-1]
        weight.register_hook(lambda g: g * (math.nan if next(count) == 1 and not team.first else 1.0))
        return model

    return build


def main(folder: Path) -> None:
    torch.set_num_threads(1)
    writes: list[str] = []
    write = checkpoint.write_bytes
    checkpoint.write_bytes = lambda path, data: (writes.append(path.name), write(path, data))[1]  # type: ignore[assignment]
    team, runs, boxes, quiet = Team.join("cpu"), folder / "runs", make_boxes(), Console(quiet=True)
    report: dict[str, Any] = {"losses": {name: losses_of(runs, name) for name in LOSSES}}
    report["gradients"] = {name: gradients_of(runs, name) for name in GRADIENTS}
    report["normed"] = {name: {str(shapes): normed(team, name, shapes) for shapes in (5, 1)} for name in NORMS}
    report["answers"], report["settled"] = answers(team), settled(team)

    # The second process alone is asked to stop; alone has a NaN; alone has an error before the first step.
    stop = after(3, lambda: not team.first)
    report["stopped"] = failure(lambda: loop.train(settings(runs, name="stopped", epochs=4), boxes, quiet, stop=stop))
    with replaced(loop, "build_recogniser", spoilt(team)):
        report["spoilt"] = loop.train(settings(runs, name="spoilt", epochs=2), boxes, quiet).metrics()
    backbone = "tiny" if team.first else "tinny"
    report["wrong"] = failure(lambda: loop.train(settings(runs, name="wrong", backbone=backbone), boxes, quiet))
    report["writes"] = writes

    # At last it is killed.
    suicide = after(4, lambda: team.first or os.kill(os.getpid(), signal.SIGKILL)) if not team.first else None
    with replaced(loop, "SAVE_EVERY_SECONDS", 0.0):
        (folder / f"rank{team.rank}.json").write_text(json.dumps(report))
        lost = failure(lambda: loop.train(settings(runs, name="killed", epochs=4), boxes, quiet, stop=suicide))
    report["lost"] = lost and {**lost, "state": Run(runs / "killed").info["state"]}
    (folder / f"rank{team.rank}.json").write_text(json.dumps(report))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
