# Every chore of this project. `just` lists them; each prints the commands it runs.
# `just` itself comes with the dev extra.

_list:
    @just --list --unsorted

# install with everything that developing needs
install:
    python -m pip install -e '.[dev]'

# lint, format check, types, rooms
check:
    ruff check .
    ruff format --check .
    mypy
    lint-imports

# bring the code into shape
format:
    ruff check --fix .
    ruff format .

# the whole test suite, on all cores
test *ARGS:
    python -m pytest -n auto {{ARGS}}

# what the continuous integration runs, from a clean environment
ci:
    bash .ci/run

# the demo: the main job, from nothing to a report
demo:
    mvtn preprocess
    mvtn train
    mvtn eval
