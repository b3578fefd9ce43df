"""`open_builtin(spec)`: a procedural data set from its one word."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass

from mvtn_cli.core.datasets.builtin import one_sided, shapes
from mvtn_cli.core.datasets.dataset import Dataset, Item
from mvtn_cli.core.shapes import Shape
from mvtn_cli.errors import UsageError, choose_error

DEFAULTS = {
    "shapes": {"train": 480, "test": 240, "seed": 0},
    "one-sided": {"train": 2304, "test": 480, "seed": 0},
}
_LARGEST = {"train": 1_000_000, "test": 1_000_000, "seed": 2**63 - 1}


@dataclass(frozen=True)
class EverydayShape:
    """Recipe of one shape of `builtin:shapes`: calling it makes the shape."""

    class_name: str
    index: int
    seed: int
    split: str

    def __call__(self) -> Shape:
        return shapes.build(self.class_name, self.index, self.seed, self.split)


@dataclass(frozen=True)
class OneSidedShape:
    """Recipe of one shape of `builtin:one-sided`: calling it makes the shape."""

    index: int
    seed: int
    split: str

    def __call__(self) -> Shape:
        return one_sided.build(self.index, self.seed, self.split)[0]


@dataclass(frozen=True)
class RecipeContent:
    """What decides a made shape: its recipe and the generator's version, as canonical JSON."""

    recipe: EverydayShape | OneSidedShape

    def __call__(self) -> bytes:
        version = shapes.VERSION if isinstance(self.recipe, EverydayShape) else one_sided.VERSION
        document = {"generator": type(self.recipe).__name__, "version": version, **asdict(self.recipe)}
        return json.dumps(document, sort_keys=True, separators=(",", ":")).encode()


def open_builtin(spec: str) -> Dataset:
    """Open `[builtin:]NAME[?train=N&test=N&seed=N]`; nothing is made until an item is read.

    Classes take turns, so that any first part of a split is balanced.

    Raises:
        UsageError: Unknown name or setting, or a number out of its range.
    """
    name, _, query = spec.removeprefix("builtin:").partition("?")
    if name not in DEFAULTS:
        raise choose_error("builtin", name, DEFAULTS)
    settings = DEFAULTS[name] | _settings(query, spec)
    if not settings["train"] and not settings["test"]:
        raise UsageError(f"'{spec}' asks for no shapes", hint="set train or test above 0", code="dataset.empty")
    changed = [f"{key}={value}" for key, value in settings.items() if value != DEFAULTS[name][key]]
    canonical = f"builtin:{name}" + ("?" + "&".join(changed) if changed else "")
    make, classes = (_everyday, shapes.CLASSES) if name == "shapes" else (_one_sided, one_sided.CLASSES)
    items = tuple(item for split in ("train", "test") for item in make(split, settings[split], settings["seed"]))
    what = "everyday shapes" if name == "shapes" else "barrels with a relief on one side"
    counts = f"{settings['train']} train, {settings['test']} test, seed {settings['seed']}"
    title = f"{what} made on the spot: {len(classes)} classes, {counts}"
    return Dataset(canonical, title, classes, items, known_view=name == "one-sided")


def _settings(query: str, spec: str) -> dict[str, int]:
    """Read `key=number` pairs."""
    settings: dict[str, int] = {}
    for pair in filter(None, query.split("&")):
        key, _, text = pair.partition("=")
        if key not in _LARGEST:
            raise choose_error("setting", key, _LARGEST)
        if key in settings:
            raise UsageError(f"{key} is given twice in '{spec}'", hint="keep one of the two", code="dataset.setting")
        readable = text.isascii() and text.isdecimal() and len(text) < 20
        if not readable or int(text) > _LARGEST[key]:
            raise UsageError(
                f"{key} in '{spec}' must be a whole number in [0, {_LARGEST[key]}], got '{text}'",
                hint=f"for example {spec.partition('?')[0]}?{key}=120",
                code="dataset.setting",
            )
        settings[key] = int(text)
    return settings


def _everyday(split: str, count: int, seed: int) -> Iterator[Item]:
    for i in range(count):
        label, index = i % len(shapes.CLASSES), i // len(shapes.CLASSES)
        name = shapes.CLASSES[label]
        recipe = EverydayShape(name, index, seed, split)
        yield _item(f"{name}/{split}_{index:04d}", label, split, f"builtin:shapes seed {seed}", recipe)


def _one_sided(split: str, count: int, seed: int) -> Iterator[Item]:
    for index in range(count):
        label = index % len(one_sided.CLASSES)
        recipe = OneSidedShape(index, seed, split)
        name = f"{one_sided.CLASSES[label]}/{split}_{index:05d}"
        yield _item(name, label, split, f"builtin:one-sided seed {seed}", recipe)


def _item(name: str, label: int, split: str, origin: str, recipe: EverydayShape | OneSidedShape) -> Item:
    return Item(name, label, split, f"{origin}, {name}", recipe, RecipeContent(recipe))
