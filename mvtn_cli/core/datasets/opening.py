"""`open_dataset(spec)`: one word says which data set."""

from __future__ import annotations

import os
import re
from pathlib import Path

from mvtn_cli.core.datasets.dataset import Dataset
from mvtn_cli.core.datasets.files import expand_glob, must_exist, readable, unlabelled, walk
from mvtn_cli.core.datasets.folder import labelled, open_folder, open_listed, recognise
from mvtn_cli.core.datasets.modelnet import KINDS as MODELNETS
from mvtn_cli.core.datasets.modelnet import MODELNET40, looks_like_modelnet, open_modelnet
from mvtn_cli.core.datasets.point_release import is_point_release, open_point_release
from mvtn_cli.errors import UsageError, choose_error

PREFIXES = ("builtin", "folder", *MODELNETS)


def open_dataset(spec: str) -> Dataset:
    """Open a data set by its one word; nothing but names is read from the disk.

    Args:
        spec: `builtin:NAME[?option=value]`, `modelnet40:PATH`, `modelnet10:PATH`, `folder:PATH[?up=z]`, or
            a plain path whose layout is recognised; one file or a glob gives a data set without labels.

    Raises:
        UsageError: The prefix or an option is unknown.
        DataError: The path is missing, holds nothing readable, or lacks a split.
    """
    prefix, rest = _split_prefix(spec)
    if prefix == "builtin":
        from mvtn_cli.core.datasets.builtin import open_builtin  # generators are heavy, and import this room

        return open_builtin(spec)
    path_text, options = _split_options(rest)
    up = _up_axis(options)
    suffix = "?up=z" if up == "z" else ""
    if prefix is None and not os.path.exists(path_text) and re.search(r"[*?\[]", path_text):
        return unlabelled(expand_glob(path_text), up=up, spec=os.path.abspath(path_text) + suffix, where=path_text)
    path = must_exist(Path(path_text).expanduser())
    if prefix in MODELNETS:
        return open_modelnet(prefix, path)
    if path.is_file():
        return unlabelled([path], up=up, spec=f"{path.absolute()}{suffix}")
    return open_folder(path, up=up) if prefix == "folder" or options else _recognised(path)


def _recognised(root: Path) -> Dataset:
    """Open a folder of which only the path was given, by what is in it."""
    spec = str(root.absolute())
    if is_point_release(root):
        return open_point_release(root, MODELNET40, spec=spec)
    files = walk(root)
    layout = recognise(found) if (found := readable(files)) else None
    if layout is not None and looks_like_modelnet(layout):
        remark = f"taken for ModelNet by its class names (folder:{root} keeps y up)"
        return labelled(root, layout, up="z", spec=spec, kind="ModelNet (OFF)", remark=remark)
    return open_listed(root, files, up="y", spec=spec)


def _split_prefix(spec: str) -> tuple[str | None, str]:
    # Two letters at least, so that C:\meshes is a path.
    match = re.match(r"([A-Za-z][A-Za-z0-9_-]+):(.*)$", spec, re.DOTALL)
    if match is None or os.path.exists(spec):
        if not spec:
            raise UsageError("the data set's name is empty", hint=_examples(), code="dataset.no-name")
        return None, spec
    prefix, rest = match.groups()
    if prefix not in PREFIXES:
        raise choose_error("kind of data set", prefix, PREFIXES)
    if not rest:
        raise UsageError(f"'{spec}' names no data set", hint=_examples(), code="dataset.no-name")
    return prefix, rest


def _split_options(text: str) -> tuple[str, dict[str, str]]:
    match = re.search(r"\?(\w+=\w*(?:&\w+=\w*)*)$", text)
    if match is None or os.path.exists(text):
        return text, {}
    return text[: match.start()], dict(pair.split("=", 1) for pair in match[1].split("&"))


def _up_axis(options: dict[str, str]) -> str:
    for name in options:
        if name != "up":
            raise choose_error("data set option", name, ["up"])
    up = options.get("up", "y")
    if up not in ("y", "z"):
        raise choose_error("up axis", up, ["y", "z"])
    return up


def _examples() -> str:
    return "for example builtin:shapes, modelnet40:PATH, folder:PATH, or a path"
