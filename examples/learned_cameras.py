"""Where did the cameras go? Open a run, draw what its cameras see, and measure how far they moved.

You learn  how mvtn is used from Python: a run, its data set and its network are three calls.
Time       five seconds. It takes the last run in ./runs: train one first.
Use        python examples/learned_cameras.py [RUN]     writes learned_cameras.png
"""
# ruff: noqa: T201

import sys
from pathlib import Path

from mvtn_cli.console import Console
from mvtn_cli.core.evaluation.views import standard_angles
from mvtn_cli.core.preprocess import Settings, open_prepared
from mvtn_cli.core.reporting import contact_sheet
from mvtn_cli.core.training.predict import load_model, predict
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.views import angle_between, circular_mean

run = Run.open(sys.argv[1]) if len(sys.argv) > 1 else Run.latest("runs")
settings = Settings.from_dict(run.info["preprocess"])
shapes = open_prepared(run.info["dataset"], run.config, Console(), settings=settings)
model = load_model(run)

test = shapes.split("test")
seen = predict(model, shapes, test, run.config, batch_size=16, keep_images=8)
azimuth, elevation = standard_angles(seen.azimuth_deg, seen.elevation_deg)  # (shapes, views), degrees
start_azimuth, start_elevation = (angle.numpy() for angle in model.selector.start)
moved = angle_between(azimuth, elevation, start_azimuth, start_elevation)

print(f"{run.path}: {run.config.views}, mean over {len(test)} test shapes, degrees")
print("view  azimuth  elevation  moved")
for view in range(azimuth.shape[1]):
    mean = circular_mean(azimuth[:, view]), elevation[:, view].mean(), moved[:, view].mean()
    print(f"{view + 1:4}  {mean[0]:7.1f}  {mean[1]:9.1f}  {mean[2]:5.1f}")

titles = [f"view {view + 1}" for view in range(azimuth.shape[1])]
sheet = contact_sheet(seen.images, row_titles=seen.names[:8], column_titles=titles)
Path("learned_cameras.png").write_bytes(sheet)
print("what they see: learned_cameras.png")
