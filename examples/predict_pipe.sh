#!/usr/bin/env bash
# Count what is in a folder full of shapes: names go in, classes come out.
#
# You learn  how `mvtn predict` works in a pipe: names from standard input, NUL-separated, so that they may hold blanks;
#            an answer a line as soon as there is one; a bad file is named on stderr and stops nothing.
# Time       four seconds, and about a hundredth of one a file. It takes the last run in ./runs: train one first.
# Use        bash examples/predict_pipe.sh FOLDER
set -euo pipefail

folder=${1:?"which folder? bash predict_pipe.sh FOLDER"}

classes() { # from one JSON object a line to one class a line
    if command -v jq >/dev/null; then
        jq -r .class
    else
        python -c 'import json, sys; [print(json.loads(line)["class"]) for line in sys.stdin]'
    fi
}

find "$folder" -type f \( -name '*.off' -o -name '*.obj' -o -name '*.ply' -o -name '*.stl' -o -name '*.glb' \) -print0 |
    mvtn predict - --jsonl --on-bad skip |
    classes | sort | uniq -c | sort -rn
