"""Whether two classifiers differ by more than chance, judged on the same shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from mvtn_cli.console import counted
from mvtn_cli.core.reporting import words
from mvtn_cli.core.reporting.comparison_runs import Answers, RunFiles

LEVEL = 0.05


def mcnemar(a_right: ArrayLike, b_right: ArrayLike) -> dict[str, Any]:
    """McNemar's exact test: do two classifiers recognise the same share of shapes?

    Only shapes that one of them recognises and the other doesn't tell anything. If both were equally good, each of
    those would fall to either side like a coin.

    Args:
        a_right: (N,) whether the first recognised the shape.
        b_right: (N,) the same of the second.

    Returns:
        `count` N, `only_a`, `only_b`, `difference` (accuracy of b minus that of a) and two-sided `p`.

    References:
        McNemar. Note on the sampling error of the difference between correlated proportions or percentages.
        Psychometrika, 1947.
    """
    a, b = np.asarray(a_right, dtype=bool), np.asarray(b_right, dtype=bool)
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    either = only_a + only_b
    return {
        "count": len(a),
        "only_a": only_a,
        "only_b": only_b,
        "difference": (only_b - only_a) / len(a) if len(a) else 0.0,
        "p": float(stats.binomtest(only_b, either, 0.5).pvalue) if either else 1.0,
    }


def holm(values: Sequence[float]) -> list[float]:
    """Raise p values so that all tests together err with the chance that one of them would (Holm 1979)."""
    order = np.argsort(values, kind="stable")
    raised = np.asarray(values, dtype=float)[order] * np.arange(len(values), 0, -1)
    adjusted = np.empty(len(values))
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(raised))
    return [float(value) for value in adjusted]


def aligned(a: Answers, b: Answers) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """The answers of both in one order; None if they were not judged on the same shapes."""
    if a.shapes == b.shapes:
        return a.right, b.right
    place = {shape: i for i, shape in enumerate(b.shapes)}
    if len(place) != len(b.shapes) or len(set(a.shapes)) != len(a.shapes) or set(a.shapes) != set(place):
        return None
    return a.right, b.right[[place[shape] for shape in a.shapes]]


def paired_tests(runs: Sequence[RunFiles]) -> list[dict[str, Any]]:
    """Test every two runs that were judged on the same shapes; the smallest p first.

    Returns:
        Of each pair `a`, `b` (labels), what `mcnemar` gives, `p_holm` over all pairs, and a `sentence`.
    """
    found = []
    for a, b in combinations([run for run in runs if run.answers is not None and len(run.answers.right)], 2):
        assert a.answers is not None and b.answers is not None
        if (both := aligned(a.answers, b.answers)) is not None:
            found.append({"a": a.label, "b": b.label, **mcnemar(*both)})
    for test, p in zip(found, holm([test["p"] for test in found]), strict=True):
        test["p_holm"] = p
        test["sentence"] = sentence(test, len(found))
    return sorted(found, key=lambda test: test["p"])  # stable: pairs of the same p stay in the runs' order


def sentence(test: Mapping[str, Any], pairs: int) -> str:
    """Say what a test found."""
    a, b, only_a, only_b = (test[key] for key in ("a", "b", "only_a", "only_b"))
    if only_a + only_b == 0:
        return f"{a} and {b} recognise exactly the same shapes."
    ahead, behind, most, least = (b, a, only_b, only_a) if only_b > only_a else (a, b, only_a, only_b)
    start = f"{ahead} recognises {counted(most, 'shape')} that {behind} does not, and the other way round {least}"
    if most == least:
        return f"{start}: neither is ahead."
    lead = f"{start}: {100 * abs(test['difference']):.1f} points ahead"
    p = f"p {'' if test['p'] < 0.001 else '= '}{p_words(test['p'])}"
    if test["p_holm"] < LEVEL:
        return f"{lead}, more than chance explains ({p})."
    if test["p"] < LEVEL:
        return f"{lead}; alone that would be clear ({p}), among {pairs} pairs it may be chance."
    return f"{lead}, which may well be chance ({p})."


def p_words(p: float) -> str:
    """Say a p value with as many digits as mean something."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def points(difference: float) -> str:
    """Say a difference of shares in points of percent, with its sign."""
    rounded = round(100 * difference, 1) + 0.0
    return f"{rounded:+.1f}".replace("-", "−") if rounded else "0.0"


def interval_words(interval: Sequence[float | None]) -> str:
    """Say a 95 % interval with a tenth of a percent, as several runs may differ by no more."""
    low, high = interval
    if low is None or high is None:
        return words.DASH
    return f"{100 * low:.1f}–{100 * high:.1f}{words.NARROW}%"
