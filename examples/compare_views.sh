#!/usr/bin/env bash
# Do learned cameras pay? Train fixed, jittered and learned views on one budget, with several seeds, and compare.
#
# You learn  why `jittered` takes part: cameras that move in training are an augmentation by themselves, and only what
#            learned views add to that is theirs. A difference whose 95 % interval holds 0 says nothing yet: more seeds.
# Time       about a minute on two cores; stop it at any time, the same command goes on.
# Use        bash examples/compare_views.sh [DATASET]
#            More to learn from: SEEDS=5 MVTN_EPOCHS=40 bash examples/compare_views.sh builtin:shapes
set -euo pipefail

export MVTN_EPOCHS=${MVTN_EPOCHS:-10} MVTN_IMAGE_SIZE=${MVTN_IMAGE_SIZE:-48} MVTN_NUM_VIEWS=${MVTN_NUM_VIEWS:-2}

mvtn train "${1:-builtin:shapes?train=240&test=240}" --compare fixed,jittered,learned --seeds "${SEEDS:-3}"
