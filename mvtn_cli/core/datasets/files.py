"""Items that are files on disk, and lists of files that nobody has labelled."""

from __future__ import annotations

import glob
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mvtn_cli.core.datasets.dataset import UNLABELLED, Dataset, Item
from mvtn_cli.core.shapes import SUFFIXES, Shape, read_shape
from mvtn_cli.errors import DataError, UsageError, nearest

Parts = tuple[str, ...]  # a path below some folder, name by name


@dataclass(frozen=True)
class ReadFile:
    """Reads one file; `up` is the axis that points up in it."""

    path: str
    up: str

    def __call__(self) -> Shape:
        return read_shape(Path(self.path), up=self.up)  # type: ignore[arg-type]


@dataclass(frozen=True)
class FileContent:
    """A file's bytes, with what else decides how they are read: the suffix and the up axis."""

    path: str
    up: str

    def __call__(self) -> bytes:
        suffix = os.path.splitext(self.path)[1].lower()
        return f"file {suffix} up={self.up}\n".encode() + Path(self.path).read_bytes()


def file_item(path: str, *, name: str, label: int, split: str, up: str) -> Item:
    """Return the item of one file."""
    return Item(name, label, split, path, ReadFile(path, up), FileContent(path, up), Path(path))


def walk(root: Path) -> list[Parts]:
    """Return every file below `root` as its path's parts, sorted; without hidden names and `__MACOSX`.

    Each folder is listed once (`os.scandir`), no file is opened or asked for its status: linear and quick.

    Raises:
        DataError: `root` itself can't be listed.
    """
    found: list[Parts] = []
    try:
        _walk(str(root), (), (os.path.realpath(root),), found)
    except OSError as error:
        raise DataError(f"can't list {root}: {error.strerror or error}", code="dataset.unreadable-folder") from error
    return sorted(found)


def _walk(folder: str, parts: Parts, linked: tuple[str, ...], found: list[Parts]) -> None:
    """Add the files of one folder; `linked` holds the real paths above it, so that a loop of links ends."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith(".") or entry.name == "__MACOSX":
                continue
            if entry.is_dir():
                target = (os.path.realpath(entry.path),) if entry.is_symlink() else ()
                if not set(target) & set(linked):
                    _walk(entry.path, (*parts, entry.name), linked + target, found)
            else:
                found.append((*parts, entry.name))


def suffix_of(name: str) -> str:
    """Return the suffix in lower case, dot included, empty if there is none."""
    return os.path.splitext(name)[1].lower()


def readable(files: Iterable[Parts], suffixes: Iterable[str] = SUFFIXES) -> list[Parts]:
    """Return the files whose suffix is one of `suffixes`."""
    wanted = frozenset(suffixes)
    return [parts for parts in files if suffix_of(parts[-1]) in wanted]


def suffix_census(files: Iterable[Parts]) -> str:
    """Say which suffixes there are, the commonest first, e.g. `412 match '*.step', 3 match '*.md'`."""
    counts = Counter(suffix_of(parts[-1]) or "(no suffix)" for parts in files)
    shown = [f"{count} match '*{suffix}'" for suffix, count in counts.most_common(3)]
    return ", ".join(shown) or "the folder is empty"


def must_exist(path: Path) -> Path:
    """Return `path` if it is there.

    Raises:
        DataError: It isn't; the hint names the sibling that looks most like it.
    """
    if path.exists():
        return path
    parent = path.absolute().parent
    missing = path.absolute()
    while not parent.is_dir() and parent != parent.parent:
        missing, parent = parent, parent.parent
    siblings = sorted(entry.name for entry in os.scandir(parent)) if os.access(parent, os.R_OK) else []
    close = nearest(missing.name, siblings)
    hint = f"did you mean {parent / close}?" if close else f"{parent} is there, '{missing.name}' in it is not"
    raise DataError(f"no such file or folder: {path}", hint=hint, code="dataset.no-such-path")


def entries(folder: Path) -> list[os.DirEntry[str]]:
    """Return what lies in a folder, in no order; nothing where there is no such folder."""
    try:
        with os.scandir(folder) as found:
            return list(found)
    except (FileNotFoundError, NotADirectoryError):
        return []


def file_names(folder: Path) -> frozenset[str]:
    """Return the names of what lies in a folder; none where there is no such folder."""
    return frozenset(entry.name for entry in entries(folder))


def unwrapped(root: Path, looks_like: Callable[[Path], bool]) -> Path | None:
    """Return the folder that `looks_like` knows: `root`, or the only folder in it, as archives often unpack."""
    if looks_like(root):
        return root
    inner = [entry.path for entry in entries(root) if entry.is_dir() and not entry.name.startswith((".", "__MACOSX"))]
    return Path(inner[0]) if len(inner) == 1 and looks_like(Path(inner[0])) else None


def unlabelled(paths: Sequence[Path | str], *, up: str = "y", spec: str = "", where: str = "") -> Dataset:
    """Return the files as a data set without classes, all in split `test`.

    Names are the paths below their common folder, without suffix where that stays unique.

    Raises:
        DataError: A file does not exist.
        UsageError: The list is empty.
    """
    if not paths:
        raise UsageError("no file was given", hint="name at least one mesh or point file", code="dataset.no-files")
    files = [str(must_exist(Path(path)).absolute()) for path in dict.fromkeys(map(str, paths))]
    common = os.path.commonpath([os.path.dirname(file) for file in files])
    names = unique_names([tuple(os.path.relpath(file, common).split(os.sep)) for file in files])
    items = [
        file_item(file, name=name, label=UNLABELLED, split="test", up=up)
        for file, name in zip(files, names, strict=True)
    ]
    plural = "" if len(items) == 1 else "s"
    title = f"{len(items)} file{plural} without labels{f' in {where}' if where else ''}, {up} up"
    return Dataset(spec or "files:" + common, title, (), tuple(items))


def expand_glob(pattern: str) -> list[str]:
    """Return the readable files that match, sorted.

    Raises:
        DataError: None does; says what was there instead.
    """
    matches = sorted(path for path in glob.glob(pattern, recursive=True) if os.path.isfile(path))
    chosen = [path for path in matches if suffix_of(path) in SUFFIXES]
    if not chosen:
        seen = suffix_census((os.path.basename(path),) for path in matches) if matches else "0 files match"
        raise DataError(f"no readable file matches '{pattern}'", hint=f"{seen}; {can_read()}", code="dataset.no-match")
    return chosen


def can_read() -> str:
    """Say which suffixes can be read."""
    return "readable are " + " ".join(sorted(SUFFIXES))


def unique_names(files: Sequence[Parts], drop: int | None = None) -> list[str]:
    """Return a name for each file: its parts without suffix and without part number `drop`.

    Where two files would share a name (`train/a.off` and `test/a.off`, or `a.off` and `a.obj`), both keep
    everything.
    """
    short = [_short_name(parts, drop) for parts in files]
    counts = Counter(short)
    return [name if counts[name] == 1 else "/".join(parts) for name, parts in zip(short, files, strict=True)]


def _short_name(parts: Parts, drop: int | None) -> str:
    kept = [part for index, part in enumerate(parts[:-1]) if index != drop]
    return "/".join([*kept, os.path.splitext(parts[-1])[0]])
