#!/usr/bin/env bash
# Train on your own meshes and look at the report.
#
# You learn  how a folder has to look (CLASS/file; a fifth of each class is set aside as test), which three steps
#            there are, and how good the result is beside a plain random forest.
# Time       half a minute on two cores for the hundred shapes that it makes; with your folder, by its size.
# Use        bash examples/own_meshes.sh [FOLDER]         UP=z if that is the axis that points up in it
#            Every setting can be given as a variable: MVTN_EPOCHS=60 MVTN_NUM_VIEWS=8 bash examples/own_meshes.sh
set -euo pipefail

folder=${1:-own_meshes}
up=${UP:-y}
export MVTN_BATCH_SIZE=${MVTN_BATCH_SIZE:-8} # a hundred shapes are few: better many small steps than three large ones

if [[ $# -eq 0 ]]; then
    up=z # as trimesh makes them
fi
if [[ $# -eq 0 && ! -d $folder ]]; then
    python - "$folder" "${SHAPES:-20}" <<'PYTHON'
import sys
from pathlib import Path

import numpy as np
import trimesh.creation as make

folder, count = Path(sys.argv[1]), int(sys.argv[2])
random = np.random.default_rng(0)
kinds = {
    "box": lambda: make.box(extents=random.uniform(0.4, 1, 3)),
    "cone": lambda: make.cone(radius=random.uniform(0.3, 1), height=random.uniform(0.5, 2)),
    "cylinder": lambda: make.cylinder(radius=random.uniform(0.2, 1), height=random.uniform(0.5, 2)),
    "egg": lambda: make.icosphere(subdivisions=3).apply_scale(random.uniform(0.5, 1, 3)),
    "ring": lambda: make.torus(major_radius=1, minor_radius=random.uniform(0.1, 0.4)),
}
for kind, shape in kinds.items():
    (folder / kind).mkdir(parents=True)
    for number in range(count):
        shape().export(folder / kind / f"{kind} {number}.ply")
PYTHON
fi

mvtn preprocess "folder:$folder?up=$up" --on-bad skip # what can't be used is named, and stays out
mvtn train                                            # on what was preprocessed last in this folder
mvtn eval --baseline                                  # the report has the random forest, too, now
