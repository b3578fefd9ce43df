"""Numbers as a person reads them; what is not known is a dash."""

from __future__ import annotations

import math

from mvtn_cli.console import duration as _duration

DASH = "–"
NARROW = "\u202f"  # a narrow space that doesn't break a line


def unknown(value: float | None) -> bool:
    """Whether there is no number."""
    return value is None or not math.isfinite(value)


def percent(share: float | None, digits: int = 1) -> str:
    """Say a share in [0, 1] as `93.4 %`."""
    return DASH if share is None or unknown(share) else f"{100 * share:.{digits}f}{NARROW}%"


def span(low: float | None, high: float | None) -> str:
    """Say an interval of shares as `89–96 %`."""
    if low is None or high is None or unknown(low) or unknown(high):
        return DASH
    return f"{100 * low:.0f}–{100 * high:.0f}{NARROW}%"


def degrees(angle: float | None, digits: int = 1, *, signed: bool = False) -> str:
    """Say an angle as `12.5°`, with a true minus sign."""
    if angle is None or unknown(angle):
        return DASH
    rounded = round(angle, digits) + 0.0  # never -0
    return f"{rounded:{'+' if signed and rounded else ''}.{digits}f}°".replace("-", "−")


def number(value: float | None, digits: int = 3) -> str:
    """Say a plain number."""
    return DASH if value is None or unknown(value) else f"{value:.{digits}g}".replace("-", "−")


def count(value: int | None) -> str:
    """Say a whole number, thousands apart."""
    return DASH if value is None else f"{value:,}".replace(",", NARROW)


def duration(seconds: float | None) -> str:
    """Say a time span."""
    return DASH if seconds is None or unknown(seconds) else _duration(seconds)
