"""A confusion matrix laid out for a page: readable with 3 classes and with 40."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

LONGEST_NAME = 22


def confusion_layout(confusion: ArrayLike, classes: Sequence[str]) -> dict[str, Any]:
    """Place the cells that are not empty.

    Args:
        confusion: (C, C) counts, row = true class, column = given class.
        classes: C names.

    Returns:
        Sizes in SVG units (`cell`, `left`, `top`, `width`, `height`, `font`), `names` (`full`, `short`), and
        `cells`, each with `row`, `column`, `count`, `share` of its row in [0, 1], `strength` to paint with,
        `right` (on the diagonal) and whether a number fits.
    """
    counts = np.asarray(confusion, dtype=np.int64).reshape(len(classes), len(classes))
    size = 42 if len(classes) <= 8 else 32 if len(classes) <= 14 else 23 if len(classes) <= 26 else 17
    font = 12.0 if size >= 32 else 11.0 if size >= 23 else 9.5
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    names = [{"full": name, "short": _short(name)} for name in classes]
    longest = max((len(name["short"]) for name in names), default=1)
    label = longest * font * 0.56 + 10
    return {
        "cell": size,
        "font": font,
        "number_font": round(min(font, size * 0.42), 1),
        "left": round(label, 1),
        "top": round(label * 0.80 + 8, 1),  # names stand at 55 degrees
        "width": round(label + size * len(classes) + label * 0.55 + 4, 1),
        "height": round(label * 0.80 + 8 + size * len(classes) + 4, 1),
        "names": names,
        "cells": [
            {
                "row": int(i),
                "column": int(j),
                "count": int(counts[i, j]),
                "share": float(shares[i, j]),
                # the square root lets a single mistake among many be seen
                "strength": round(0.12 + 0.78 * float(np.sqrt(shares[i, j]) if i != j else shares[i, j]), 2),
                "right": bool(i == j),
            }
            for i, j in np.argwhere(counts)
        ],
    }


def _short(name: str) -> str:
    return name if len(name) <= LONGEST_NAME else name[: LONGEST_NAME - 1] + "…"
