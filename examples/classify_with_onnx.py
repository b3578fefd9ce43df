"""Classify shapes without torch: numpy, onnxruntime, and the pictures that mvtn draws.

You learn  what the files of `mvtn export` take and give, and which pictures they are meant for.
Time       ten seconds, after: mvtn export RUN (it needs pip install mvtn[export])
Use        python examples/classify_with_onnx.py RUN FILE [FILE ...]     a line each: file, class, probability
"""
# ruff: noqa: T201

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import onnxruntime

run, *files = sys.argv[1:]
labels = (Path(run) / "export" / "labels.txt").read_text(encoding="utf-8").splitlines()
network = onnxruntime.InferenceSession(Path(run) / "export" / "network.onnx", providers=["CPUExecutionProvider"])
shapes = {one.name: one.shape for one in network.get_inputs()}  # the first axis is free: any number of shapes
if "images" not in shapes or "points" in shapes:
    sys.exit(f"{run} looks at points: give network.onnx the first {shapes['points'][1]} of the stored shape")

with tempfile.TemporaryDirectory() as folder:
    # The cameras and the settings of pictures are the run's own; its size of pictures has to be asked for.
    size = ["--image-size", str(shapes["images"][-1])]
    command = ["mvtn", "render-views", *files, "--run", run, *size, "--outputs", "arrays", "--out", folder, "--jsonl"]
    answer = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    drawn = [json.loads(line) for line in answer.stdout.splitlines() if '"arrays"' in line]
    arrays = [np.load(one["arrays"]) for one in drawn]
    inputs = {"images": np.stack([one["rgb"] for one in arrays]).astype(np.float32) / 255}  # (B, M, 3, H, W)
    azimuth, elevation = (np.radians([one[name] for one in arrays]) for name in ("azimuth_deg", "elevation_deg"))

if "directions" in shapes:  # (B, M, 3): from the shape to its cameras, y up
    level = np.cos(elevation)
    towards = [level * np.sin(azimuth), np.sin(elevation), level * np.cos(azimuth)]
    inputs["directions"] = np.stack(towards, axis=-1).astype(np.float32)

logits, descriptor = network.run(["logits", "descriptor"], inputs)
odds = np.exp(logits - logits.max(axis=1, keepdims=True))
probability = odds / odds.sum(axis=1, keepdims=True)
for one, row in zip(drawn, probability, strict=True):
    print(one["file"], labels[row.argmax()], f"{row.max():.4f}", sep="\t")
