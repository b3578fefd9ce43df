"""Files of a run, each whole or not there: weights as safetensors, the state of a training as one file."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_safetensors
from safetensors.torch import save as save_safetensors
from torch import Tensor

from mvtn_cli.core.store.atomic import write_bytes
from mvtn_cli.errors import DataError, MvtnError


def write_run_file(path: Path, data: bytes) -> None:
    """Write a file of a run so that it is the old one or the whole new one, also after `kill -9`.

    Raises:
        MvtnError: The folder can't be written, or the disk is full.
    """
    try:
        write_bytes(path, data)
    except MvtnError as error:
        error.hint = "free some space, or name another folder with --runs or --out"
        raise


def write_json(path: Path, document: Any) -> None:
    """Write a JSON document; numbers that JSON does not have become null."""
    write_run_file(path, (json.dumps(finite_or_null(document), indent=2) + "\n").encode())


def finite_or_null(document: Any) -> Any:
    """The same document with NaN and infinity as None."""
    if isinstance(document, dict):
        return {key: finite_or_null(value) for key, value in document.items()}
    if isinstance(document, list | tuple):
        return [finite_or_null(value) for value in document]
    return None if isinstance(document, float) and not math.isfinite(document) else document


def write_weights(path: Path, weights: dict[str, Tensor], about: dict[str, Any]) -> None:
    """Write weights as safetensors; `about` goes into its header as JSON under the key `mvtn`."""
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in weights.items()}
    write_run_file(path, save_safetensors(plain, metadata={"mvtn": json.dumps(finite_or_null(about))}))


def read_weights(path: Path) -> dict[str, Tensor]:
    """Read weights on the CPU.

    Raises:
        DataError: The file is missing or broken.
    """
    try:
        return load_safetensors(path.read_bytes())
    except (OSError, SafetensorError) as error:
        raise DataError(
            f"can't read the weights in {path}: {error}",
            hint="try the others, --checkpoint last or best; or train again: mvtn train",
            code="run.weights",
        ) from error


def write_state(path: Path, state: dict[str, Any]) -> None:
    """Write the state of a training: tensors, numbers, strings, lists and dicts of them."""
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_run_file(path, buffer.getvalue())


def read_state(path: Path) -> dict[str, Any]:
    """Read what `write_state` wrote, on the CPU; nothing in the file is executed.

    Raises:
        DataError: The file is broken.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)  # noqa: TID251 -- the one place for it
    except Exception as error:  # torch raises many kinds for a broken file
        raise DataError(
            f"can't read the state in {path}: {error}",
            hint=f"delete {path.parent} to begin that training anew",
            code="run.state",
        ) from error
    return dict(state)
