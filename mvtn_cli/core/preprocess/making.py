"""One item from its file to its place in the store. Runs in any process; remembers nothing."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from mvtn_cli.core.datasets import Item
from mvtn_cli.core.preprocess.mapping import Numbered
from mvtn_cli.core.preprocess.settings import Settings
from mvtn_cli.core.shapes import (
    Finding,
    Shape,
    Simplification,
    normalise,
    sample_surface,
    simplify,
    split_creases,
    validate,
    vertex_normals,
)
from mvtn_cli.core.store import Store, StoredShape
from mvtn_cli.errors import MvtnError

State = Literal["made", "reused", "remade", "rejected"]


@dataclass(frozen=True)
class Outcome:
    """What became of one item.

    Attributes:
        address: Where its shape is stored; empty if its content could not be read.
        state: `remade` is `made` in the place of a file that did not verify.
        findings: As dicts with name, count, fatal, detail, mended.
        simplification: Vertices and faces before and after, error; None if nothing was simplified.
        known_azimuth_deg: Azimuth of the best view, None if none is known.
        stamp: Bytes and time of the stored file, by which a later run knows that it verified.
    """

    address: str
    state: State
    findings: tuple[dict[str, Any], ...] = ()
    simplification: dict[str, Any] | None = None
    known_azimuth_deg: float | None = None
    stamp: tuple[int, int] | None = None


class _Unusable(Exception):
    """A fatal finding; carries all findings."""

    def __init__(self, findings: Sequence[dict[str, Any]]) -> None:
        super().__init__()
        self.findings = tuple(findings)


def make_all(store: Store, items: Sequence[Numbered], settings: Settings) -> list[tuple[int, Outcome]]:
    """Make each item's stored shape, if it is not there; what a worker process is sent."""
    return [(index, make(store, item, settings)) for index, item in items]


def make(store: Store, item: Item, settings: Settings) -> Outcome:
    """Make the stored shape of one item, or find it already there and whole.

    A bad file gives an outcome with a fatal finding, whatever goes wrong in reading it: one of many
    thousand must not end the work on all others.

    Raises:
        MvtnError: The store can't be written.
    """
    try:
        content = item.content()
    except Exception as error:
        return Outcome("", "rejected", (_failure(error, item),))
    address = settings.address(content)
    with store.lock(address):
        existed = store.stamp(address) is not None
        if (found := store.read_with_notes(address)) is not None:
            return _outcome(store, address, "reused", found[0], found[1])
        return _make_new(store, item, address, settings, "remade" if existed else "made")


def _make_new(store: Store, item: Item, address: str, settings: Settings, state: State) -> Outcome:
    try:
        shape, notes, seconds = build(item.read(), settings, address)
    except _Unusable as unusable:
        return Outcome(address, "rejected", unusable.findings)
    except Exception as error:
        return Outcome(address, "rejected", (_failure(error, item),))
    store.write(address, shape, notes)
    return _outcome(store, address, state, shape, notes, seconds)


def build(shape: Shape, settings: Settings, address: str) -> tuple[StoredShape, dict[str, Any], float]:
    """Return the stored form of `shape`, what is worth knowing about it, and the seconds spent simplifying.

    The points' seed comes from the address, so that a shape's points depend on nothing but itself.
    """
    shape, findings = validate(shape)
    listed = [asdict(finding) for finding in findings]
    if any(finding.fatal for finding in findings):
        raise _Unusable(listed)
    shape, center, radius = normalise(shape)
    start = time.perf_counter()
    shape, simplification = simplify(shape, settings.max_vertices)
    seconds = time.perf_counter() - start
    origin, faces = split_creases(shape.vertices, shape.faces)
    vertices = shape.vertices[origin]
    points, point_colors = sample_surface(shape, settings.num_points, int(address[:8], 16))
    stored = StoredShape(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        normals=vertex_normals(vertices, faces).astype(np.float32),
        colors=None if shape.colors is None else shape.colors[origin].astype(np.float32),
        points=points.astype(np.float32),
        point_colors=None if point_colors is None else point_colors.astype(np.float32),
        center=np.asarray(center, dtype=np.float64),
        radius=float(radius),
        known_azimuth_deg=float("nan") if shape.known_azimuth_deg is None else shape.known_azimuth_deg,
    )
    return stored, {"findings": listed, "simplification": _without_time(simplification)}, seconds


def _without_time(simplification: Simplification | None) -> dict[str, Any] | None:
    """Return the numbers that depend on the mesh alone: a stored file must come out the same each time."""
    if simplification is None:
        return None
    return {name: value for name, value in asdict(simplification).items() if name != "seconds"}


def _outcome(
    store: Store,
    address: str,
    state: State,
    shape: StoredShape,
    notes: dict[str, Any],
    seconds: float | None = None,
) -> Outcome:
    azimuth = shape.known_azimuth_deg
    simplification = notes.get("simplification")
    return Outcome(
        address,
        state,
        tuple(notes.get("findings", ())),
        simplification and {**simplification, "seconds": seconds},
        None if np.isnan(azimuth) else azimuth,
        store.stamp(address),
    )


def _failure(error: Exception, item: Item) -> dict[str, Any]:
    """Return the fatal finding of an exception, in one line; the file's name stands beside it."""
    if isinstance(error, MvtnError):
        detail, name = error.message.removeprefix(item.source).lstrip(":, "), "unreadable"
    elif isinstance(error, OSError):
        detail, name = error.strerror or type(error).__name__, "unreadable"
    else:
        detail, name = f"{type(error).__name__} {error}", "unexpected-error"
    return asdict(Finding(name, 1, fatal=True, detail=" ".join(detail.split())[:300], mended=False))
