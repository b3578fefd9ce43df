"""Reading weight files, and holding them against the network they are meant for."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from mvtn_cli.errors import DataError

SHOWN = 8  # differences that an error names

# names in torchvision's own older files, and what they are today: DenseNets and vision transformers
OLD_NAMES = (
    (re.compile(r"(denselayer\d+\.(?:norm|conv))\.([12]\.)"), r"\1\2"),
    (re.compile(r"\.mlp\.linear_1\."), ".mlp.0."),
    (re.compile(r"\.mlp\.linear_2\."), ".mlp.3."),
)


def read_weights(path: Path) -> dict[str, Tensor]:
    """Read a state dict from a .safetensors file, or from one that `torch.save` wrote (.pt, .pth).

    Wrappings that checkpoints often have (`{"state_dict": ...}`, `{"model": ...}`, names that all start with
    `module.`) are taken off.

    Raises:
        DataError: There is no such file, it is damaged, or holds something else than named tensors.
    """
    if not path.is_file():
        raise DataError(
            f"no weight file {path}",
            hint="--weights takes none, imagenet, a file or the folder of a run",
            code="weights.missing",
        )
    try:
        content = load_file(path) if path.suffix == ".safetensors" else _unpickle(path)
    except Exception as error:  # whatever a damaged file makes the two readers raise
        reason = (str(error).strip() or type(error).__name__).splitlines()[0][:160]
        raise DataError(
            f"can't read weights from {path}: {reason}",
            hint="expected a whole .safetensors file, or a state dict saved by torch.save (.pt, .pth)",
            code="weights.unreadable",
        ) from error
    return _named_tensors(content, path)


def _unpickle(path: Path) -> Any:
    # the one place that reads pickles of others; weights_only lets tensors and plain containers through, no
    # code
    return torch.load(path, map_location="cpu", weights_only=True)  # noqa: TID251


def _named_tensors(content: Any, path: Path) -> dict[str, Tensor]:
    for wrapping in ("state_dict", "model"):
        if isinstance(content, Mapping) and isinstance(content.get(wrapping), Mapping):
            content = content[wrapping]
    if not isinstance(content, Mapping) or not all(isinstance(value, Tensor) for value in content.values()):
        raise DataError(
            f"{path} holds no named tensors but a {type(content).__name__}",
            hint="save model.state_dict(), not the model",
            code="weights.unreadable",
        )
    if content and all(name.startswith("module.") for name in content):
        return {name.removeprefix("module."): value for name, value in content.items()}
    return dict(content)


def load_strictly(
    module: nn.Module,
    state: Mapping[str, Tensor],
    *,
    ignored: tuple[str, ...] = (),
    network: str,
    source: str,
) -> None:
    """Load a state dict that must fit: every tensor there, of its shape, and none besides.

    Args:
        module: The network; unchanged if the weights do not fit.
        state: Names to tensors.
        ignored: Parts of the file's network that `module` leaves out (its head), as prefixes of names.
        network: Its name, for the error.
        source: Where the weights come from, for the error.

    Raises:
        DataError: They do not fit; names what is missing, unexpected or of another shape.
    """
    state = {_today(name): value for name, value in state.items() if not name.startswith(ignored)}
    expected = module.state_dict()
    # files older than PyTorch 0.4.1 lack these counters, which nothing here uses
    counters = {name for name in expected if name.endswith("num_batches_tracked") and name not in state}
    differences = _differences({n: v for n, v in expected.items() if n not in counters}, state)
    if differences:
        shown = "".join(f"\n  {line}" for line in differences[:SHOWN])
        more = f"\n  … and {len(differences) - SHOWN} more" if len(differences) > SHOWN else ""
        raise DataError(
            f"weights from {source} do not fit {network}, {len(differences)} differences:{shown}{more}",
            hint="--backbone must name the network that the file was made with",
            code="weights.mismatch",
        )
    # over the network's own dict, which has the version numbers that some of torchvision's ask for
    expected.update(state)
    module.load_state_dict(expected)


def _today(name: str) -> str:
    for pattern, replacement in OLD_NAMES:
        name = pattern.sub(replacement, name)
    return name


def _differences(expected: Mapping[str, Tensor], state: Mapping[str, Tensor]) -> list[str]:
    """One line for each tensor that is missing, unexpected or of another shape."""
    missing = [f"missing     {n} {tuple(v.shape)}" for n, v in expected.items() if n not in state]
    unexpected = [f"unexpected  {n} {tuple(v.shape)}" for n, v in state.items() if n not in expected]
    reshaped = [
        f"shape       {n} is {tuple(state[n].shape)}, expected {tuple(v.shape)}"
        for n, v in expected.items()
        if n in state and state[n].shape != v.shape
    ]
    return reshaped + missing + unexpected
