"""From pictures back to points: let cameras look at a mesh, and find its surface again in the depth they saw.

You learn  what cameras.json and a depth picture hold, and the way from a pixel to the units of the file.
Time       five seconds.
Use        python examples/depth_to_points.py [MESH]     writes depth_to_points/ and depth_to_points.xyz
"""
# ruff: noqa: T201

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

mesh_file, out = Path(sys.argv[1] if len(sys.argv) > 1 else "ring.off"), Path("depth_to_points")
if len(sys.argv) < 2:
    trimesh.creation.torus(major_radius=50, minor_radius=15).export(mesh_file)

command = ["mvtn", "render-views", str(mesh_file), "--outputs", "depth", "--cameras", "--out", str(out), "--jsonl"]
views = ["--layout", "icosahedral", "--num-views", "12"]
answer = subprocess.run([*command, *views], check=True, stdout=subprocess.PIPE)
cameras = Path(json.loads(answer.stdout)["cameras"])

document = json.loads(cameras.read_text(encoding="utf-8"))
lens, points = document["intrinsics"], []
for view in document["views"]:
    steps = np.asarray(Image.open(cameras.parent / view["depth"]))  # 16 bits; 0 is background
    row, column = np.nonzero(steps)
    depth = steps[row, column] / document["depth_steps_per_radius"]  # along the optical axis, shape radii
    x, y = (column + 0.5 - lens["cx"]) / lens["focal"], -(row + 0.5 - lens["cy"]) / lens["focal"]
    in_camera = np.stack([x, y, -np.ones_like(x)], axis=-1) * depth[:, None]  # looking along -z
    rotation, shift = np.split(np.array(view["world_to_camera"]), [3], axis=1)
    in_world = (in_camera - shift.T) @ rotation  # rotation.T @ (in_camera - shift), for rows
    points.append(in_world * document["radius"] + document["center"])  # the units of the file

found = np.concatenate(points)
np.savetxt("depth_to_points.xyz", found, fmt="%.6g")
print(f"{len(found)} points of {len(points)} pictures: depth_to_points.xyz")
for name, (low, high) in (("the file", trimesh.load(mesh_file).bounds), ("points", (found.min(0), found.max(0)))):
    print(f"{name:8}  from {np.round(low, 2)} to {np.round(high, 2)}")
