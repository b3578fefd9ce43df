"""`open_dataset(spec)`: one word says which data set."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from mvtn_cli.core.datasets.dataset import Dataset
from mvtn_cli.core.datasets.files import expand_glob, must_exist, readable, unlabelled, unwrapped, walk
from mvtn_cli.core.datasets.folder import labelled, open_folder, open_listed, recognise
from mvtn_cli.core.datasets.listed import refuse_empty_split, refuse_labels, refuse_missing
from mvtn_cli.core.datasets.modelnet import KINDS as MODELNETS
from mvtn_cli.core.datasets.modelnet import MODELNET40, looks_like_modelnet, open_modelnet, release_of
from mvtn_cli.core.datasets.point_release import is_point_release, open_point_release
from mvtn_cli.core.datasets.resampled import is_resampled, open_resampled
from mvtn_cli.core.datasets.scanobjectnn import is_scanobjectnn, open_scanobjectnn
from mvtn_cli.core.datasets.shapenet import is_shapenet, open_shapenet
from mvtn_cli.errors import UsageError, choose_error

WITH_VARIANTS: dict[str, Callable[[Path, str | None], Dataset]] = {
    "shapenet55": open_shapenet,
    "scanobjectnn": open_scanobjectnn,
}
RELEASES = (*MODELNETS, *WITH_VARIANTS)
PREFIXES = ("builtin", "folder", *RELEASES)
OPTIONS = {"up": ("y", "z"), "missing": ("fail", "skip")}


@dataclass(frozen=True)
class Word:
    """A data set's one word, in its parts: `PREFIX:PATH@VARIANT?OPTION=VALUE`."""

    prefix: str | None
    path: str
    variant: str | None = None
    options: dict[str, str] = field(default_factory=dict)


def open_dataset(spec: str) -> Dataset:
    """Open a data set by its one word; nothing but names and labels is read from the disk.

    Args:
        spec: `builtin:NAME[?option=value]`, `modelnet40:PATH`, `modelnet10:PATH`,
            `shapenet55:PATH[@normal|@perturbed]`, `scanobjectnn:PATH[@VARIANT]`, `folder:PATH[?up=z]`, or a plain path
            whose layout is recognised; one file or a glob gives a data set without labels. `?missing=skip` opens a
            release although parts that its list names are not there.

    Raises:
        UsageError: The prefix, variant or an option is unknown.
        DataError: The path is missing, holds nothing readable, lacks a part or a split, or a label is out of range.
    """
    dataset = survey(spec)
    word = _release_word(dataset)
    if word:
        root = Path(_parse(dataset.spec).path)
        if _parse(spec).options.get("missing", "fail") == "fail":
            refuse_missing(dataset, word, root)
        refuse_empty_split(dataset, word, root)
    refuse_labels(dataset)
    return dataset


def survey(spec: str) -> Dataset:
    """Like `open_dataset`, but missing parts and labels out of range are left for whoever asks to count.

    Raises:
        UsageError: The prefix, variant or an option is unknown.
        DataError: The path is missing, holds nothing readable, or a file or list is damaged.
    """
    word = _parse(spec)
    if word.prefix == "builtin":
        from mvtn_cli.core.datasets.builtin import open_builtin  # generators are heavy, and import this room

        return open_builtin(spec)
    options = _checked(word)
    up = options.get("up", "y")
    suffix = "?up=z" if up == "z" else ""
    if word.prefix is None and not os.path.exists(word.path) and re.search(r"[*?\[]", word.path):
        return unlabelled(expand_glob(word.path), up=up, spec=os.path.abspath(word.path) + suffix, where=word.path)
    path = must_exist(Path(word.path).expanduser())
    if word.prefix in RELEASES:
        return _keeping(options, _open_release(word.prefix, path, word.variant))
    if path.is_file():
        return unlabelled([path], up=up, spec=f"{path.absolute()}{suffix}")
    return open_folder(path, up=up) if word.prefix == "folder" or options else _recognised(path)


def _open_release(prefix: str, path: Path, variant: str | None) -> Dataset:
    open_variant = WITH_VARIANTS.get(prefix)
    return open_variant(path, variant) if open_variant else open_modelnet(prefix, path)


def _keeping(options: dict[str, str], dataset: Dataset) -> Dataset:
    """Write into the data set's word that missing parts were skipped: a run opens it again by that."""
    skip = options.get("missing") == "skip"
    return replace(dataset, spec=f"{dataset.spec}?missing=skip") if skip else dataset


def _recognised(root: Path) -> Dataset:
    """Open a folder of which only the path was given, by what is in it."""
    spec = str(root.absolute())
    if folder := unwrapped(root, is_point_release):
        return open_point_release(folder, MODELNET40, spec=spec)
    if folder := unwrapped(root, is_resampled):
        number = 40 if (folder / "modelnet40_train.txt").is_file() else 10
        return open_resampled(folder, number, spec=f"modelnet{number}:{root.absolute()}")
    for looks_like, open_release, word in (
        (is_shapenet, open_shapenet, "shapenet55"),
        (is_scanobjectnn, open_scanobjectnn, "scanobjectnn"),
    ):
        if folder := unwrapped(root, looks_like):
            dataset = open_release(folder)
            return replace(dataset, title=f"{dataset.title}; taken for {word} (folder:{root} takes it as it lies)")
    files = walk(root)
    layout = recognise(found) if (found := readable(files)) else None
    if layout is not None and looks_like_modelnet(layout):
        remark = f"taken for ModelNet by its class names (folder:{root} keeps y up)"
        release = release_of(layout.classes())
        dataset = labelled(root, layout, up="z", spec=spec, kind="ModelNet (OFF)", remark=remark)
        return replace(dataset, release=release)
    return open_listed(root, files, up="y", spec=spec)


def _release_word(dataset: Dataset) -> str | None:
    """Return the word of the release that a data set was opened as, None for any other."""
    prefix = dataset.spec.partition(":")[0]
    return prefix if prefix in RELEASES else None


def _parse(spec: str) -> Word:
    prefix, rest = _split_prefix(spec)
    if prefix == "builtin":
        return Word(prefix, rest)
    path, options = _split_options(rest)
    variant = None
    if prefix in WITH_VARIANTS and "@" in path and not os.path.exists(path):
        path, _, variant = path.rpartition("@")
    return Word(prefix, path, variant, options)


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


def _checked(word: Word) -> dict[str, str]:
    """Return the options, after a look at their names and values."""
    allowed = ["missing"] if word.prefix in RELEASES else ["up"]
    for name, value in word.options.items():
        if name not in allowed:
            raise choose_error("data set option", name, allowed)
        if value not in OPTIONS[name]:
            what = "up axis" if name == "up" else f"value of '{name}'"
            raise choose_error(what, value, OPTIONS[name])
    return word.options


def _examples() -> str:
    return "for example builtin:shapes, modelnet40:PATH, folder:PATH, or a path"
