"""What was left out for the scenes that a process has drawn, what was not, and why: the words of `--explain`."""

from __future__ import annotations

from mvtn_cli.core.render.skips import BITS, active_skips
from mvtn_cli.core.render.tally import Tally

# By name: what is counted, and why it may be none.
WORDS = {
    "frustum": ("faces outside the image or behind the camera", "all lie in the image"),
    "backface": ("faces seen from behind", "no part is proved closed with the camera outside, or none faces away"),
    "no-sample": ("faces that cover no sample", "all cover one"),
    "occluded": ("faces behind what already covers their tile", "too few faces for tiles to pay, or none is hidden"),
    "background": ("samples outside the shape's rectangle", "the shape fills the image"),
    "near-clip": ("faces that need no clipping", "all reach the near plane"),
    "same-view": ("views that equal another", "all differ"),
    "no-gradient": ("views without incoming gradient", "all have one, or nothing asked for a gradient"),
    "fixed-views": ("views painted from what was seen before", "all are new, move, or are of points"),
}
# What never happens where it is not needed, so that no switch could bring it back: said where it was counted.
STRUCTURAL = {
    "point-encoder": "shapes whose points no network had to see, as their views do not depend on them",
    "eval-cache": "shapes described before with these weights and settings",
}


def explain(tally: Tally) -> list[str]:
    """One sentence for each skip, of what has been counted so far."""
    structural = [_counted(name, words, tally) for name, words in STRUCTURAL.items() if tally.left_out[name]]
    return [_sentence(name, tally) for name in WORDS] + structural


def _counted(name: str, words: str, tally: Tally) -> str:
    left_out, of = tally.left_out[name], tally.of[name]
    return f"{name}: {left_out:,} of {of:,} left out ({100 * left_out / of:.0f} %): {words}"


def _sentence(name: str, tally: Tally) -> str:
    words, none = WORDS[name]
    if not active_skips() & BITS[name]:
        return f"{name}: off (--no-skip)"
    return _counted(name, words, tally) if tally.left_out[name] else f"{name}: nothing left out: {none}"
