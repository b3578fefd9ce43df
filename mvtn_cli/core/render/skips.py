"""What a scene does not need, by name: each can be switched off, is counted, and changes nothing but the time.

The kernels take the bits of those that concern them; the rest is decided around them.
"""

from __future__ import annotations

from collections.abc import Iterable

from mvtn_cli.errors import choose_error

FRUSTUM, BACKFACE, NO_SAMPLE, OCCLUDED, BACKGROUND, NEAR_CLIP, SHADING_TERMS = (1 << n for n in range(7))
NO_GRADIENT, SAME_VIEW, FIXED_VIEWS = 1 << 7, 1 << 8, 1 << 9
BITS = {
    "frustum": FRUSTUM,
    "backface": BACKFACE,
    "no-sample": NO_SAMPLE,
    "occluded": OCCLUDED,
    "background": BACKGROUND,
    "near-clip": NEAR_CLIP,
    "shading-terms": SHADING_TERMS,
    "no-gradient": NO_GRADIENT,
    "same-view": SAME_VIEW,
    "fixed-views": FIXED_VIEWS,
}
EVERYTHING = sum(BITS.values())
# Places in the row of counters that a view's kernels fill: faces, drawn or left out for one reason; faces that took the
# way over the near plane; samples.
SEEN, DRAWN, OUTSIDE, BEHIND_SOLID, COVERS_NOTHING, HIDDEN, CLIPPED, EMPTY_SAMPLES, SAMPLES = range(9)
COUNTERS = 9


def without(names: Iterable[str]) -> int:
    """The bits of all skips but these.

    Raises:
        UsageError: A name that no skip has.
    """
    bits = EVERYTHING
    for name in names:
        if name not in BITS:
            raise choose_error("skip", name, BITS)
        bits &= ~BITS[name]
    return bits


_active = EVERYTHING


def use_skips(but: Iterable[str]) -> None:
    """Leave out, in this process, whatever may be left out but these.

    Raises:
        UsageError: A name that no skip has.
    """
    global _active
    _active = without(but)


def active_skips() -> int:
    """The bits that hold in this process."""
    return _active
