"""What a data set's doctor learns from each shape, in any number of processes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from mvtn_cli.console import Console
from mvtn_cli.core.datasets import Item
from mvtn_cli.core.preprocess.clues import Winding, asymmetry, fingerprint, winding
from mvtn_cli.core.preprocess.mapping import Numbered, map_items, worker_count
from mvtn_cli.core.shapes import Shape, sample_surface, validate
from mvtn_cli.errors import Interrupted, MvtnError

SAMPLES = 1024  # points by which a mesh's up axis is judged
EMPTY = ("no-faces", "no-points", "single-point", "zero-area-faces", "repeated-index-faces")


@dataclass(frozen=True)
class Examined:
    """What one shape looks like.

    Attributes:
        state: `unreadable` is a bad file, `empty` one without anything to draw.
        reason: Why it is not `ok`, in one line.
        fingerprint: Equal for copies, see `clues.fingerprint`; empty unless `ok`.
        findings: Names of what preprocessing mends in it.
        winding: Of a mesh; None for a point cloud.
        asymmetry: Along x, y and z, see `clues.asymmetry`; None unless `ok`.
    """

    state: Literal["ok", "unreadable", "empty"]
    reason: str = ""
    fingerprint: str = ""
    findings: tuple[str, ...] = ()
    winding: Winding | None = None
    asymmetry: tuple[float, float, float] | None = None


def examine_all(items: Sequence[Item], console: Console, workers: int | None = None) -> list[Examined]:
    """Read and look at each item; bad ones don't stop the others.

    Args:
        items: Of a data set.
        console: For progress.
        workers: Processes; None is one a core.

    Raises:
        Interrupted: Ctrl-C.
    """
    done: dict[int, Examined] = {}
    numbered = list(enumerate(items))
    try:
        with console.progress("examine", total=len(items)) as ticker:
            for batch in map_items(_examine_batch, numbered, worker_count(workers)):
                done.update(batch)
                ticker.advance(len(batch))
    except KeyboardInterrupt:
        raise Interrupted(f"{len(done)} of {len(items)} shapes were examined", hint="nothing was kept") from None
    return [done[index] for index in range(len(items))]


def _examine_batch(items: Sequence[Numbered]) -> list[tuple[int, Examined]]:
    return [(index, examine(item)) for index, item in items]


def examine(item: Item) -> Examined:
    """Read one item and look at it; whatever goes wrong is part of the answer."""
    try:
        return _look_at(item.read())
    except Exception as error:  # one of many thousand files must not end the work on all others
        told = error.message if isinstance(error, MvtnError) else f"{type(error).__name__} {error}"
        reason = told.removeprefix(item.source).lstrip(":, ")
        return Examined("unreadable", " ".join(reason.split())[:300])


def _look_at(shape: Shape) -> Examined:
    shape, findings = validate(shape)
    names = tuple(finding.name for finding in findings)
    if findings and findings[-1].fatal:
        last = findings[-1]
        state: Literal["empty", "unreadable"] = "empty" if last.name in EMPTY else "unreadable"
        return Examined(state, f"{last.name}: {last.detail}", findings=names)
    if shape.is_cloud:
        assert shape.points is not None
        return Examined("ok", "", fingerprint(shape.points), names, None, asymmetry(shape.points))
    points, _ = sample_surface(shape, SAMPLES, 0)
    turned = winding(shape.vertices, shape.faces)
    return Examined("ok", "", fingerprint(shape.vertices), names, turned, asymmetry(points))
