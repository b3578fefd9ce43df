"""mvtn from Python in ten lines: shapes, a trained network, its answers, and a gradient through pictures.

You learn  which calls the commands are made of; docs/library.md says more about each.
Time       five seconds. It takes the last run in ./runs: train one first.
Use        python examples/ten_lines.py [RUN]
"""
# ruff: noqa: T201

import sys

import torch

from mvtn_cli.console import Console
from mvtn_cli.core.preprocess import Settings, open_prepared
from mvtn_cli.core.render import Look, render
from mvtn_cli.core.training.predict import load_model, predict
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.training.shapes import load_batch
from mvtn_cli.core.views import Cameras

run = Run.open(sys.argv[1]) if len(sys.argv) > 1 else Run.latest("runs")
prepared = Settings.from_dict(run.info["preprocess"])
shapes = open_prepared(run.info["dataset"], run.config, Console(quiet=True), settings=prepared)
model = load_model(run)
said = predict(model, shapes, shapes.split("test"), run.config, batch_size=16)
print(f"{said.accuracy:.1%} of {len(said.names)} test shapes; {said.names[0]}: {run.classes[said.logits[0].argmax()]}")

batch, kind = load_batch(shapes, shapes.split("test")[:1], run.config.render)
azimuth = torch.tensor([20.0, 140.0, 260.0], requires_grad=True)  # of three cameras, degrees
cameras = Cameras.at(azimuth, 30.0, run.config.distance, fov_deg=run.config.fov)
pictures = render(batch, cameras, Look.evaluation(run.config, 1, kind)).rgb  # (1, 3, 3, H, W) in [0, 1]
pictures.sum().backward()
print("more light by turning each camera:", ", ".join(f"{slope:+.3f} a degree" for slope in azimuth.grad.tolist()))
