"""What a training left in its folder, as another one takes it up: its settings and its weights."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from safetensors.torch import load_file
from torch import Tensor

from mvtn_cli.errors import DataError

CHECKPOINTS = ("best", "last")


class RunFiles(NamedTuple):
    """Of one run.

    Attributes:
        folder: Where it lies.
        settings: What its `config.toml` says.
        weights: All its tensors, of the best epoch if there is one.
    """

    folder: Path
    settings: dict[str, Any]
    weights: dict[str, Tensor]

    def part(self, prefix: str) -> dict[str, Tensor]:
        """The tensors of one network, without the part of their names that says so."""
        return {n.removeprefix(prefix): value for n, value in self.weights.items() if n.startswith(prefix)}


def read_run(folder: Path) -> RunFiles:
    """Read a run's settings and weights.

    Args:
        folder: Its folder, or one of the weight files in it.

    Raises:
        DataError: It is no run, has no weights yet, or can't be read.
    """
    chosen = None
    if folder.is_file():
        chosen, folder = folder, folder.parent
    settings = folder / "config.toml"
    if not settings.is_file():
        raise DataError(
            f"{folder} is not the folder of a run: it has no config.toml",
            hint="name a folder as runs/NAME, which mvtn train has made",
            code="run.none",
        )
    path = chosen or next((p for c in CHECKPOINTS if (p := folder / f"{c}.safetensors").is_file()), None)
    if path is None:
        raise DataError(f"run {folder.name} has no weights yet", hint="finish its training", code="run.no-weights")
    try:
        return RunFiles(folder, tomllib.loads(settings.read_text(encoding="utf-8")), load_file(path))
    except Exception as error:  # whatever a damaged file makes the two readers raise
        reason = (str(error).strip() or type(error).__name__).splitlines()[0][:160]
        raise DataError(f"can't read the run in {folder}: {reason}", hint="take another run", code="run.weights") from (
            error
        )


def is_run(path: Path) -> bool:
    """Whether a path is the folder of a run, or a weight file in one."""
    return ((path if path.is_dir() else path.parent) / "config.toml").is_file()
