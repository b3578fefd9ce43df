"""How much was left out, since the process began: what `--explain` and `mvtn bench skips` tell."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from mvtn_cli.core.render import skips


@dataclass
class Tally:
    """Counts by name of skip.

    Attributes:
        left_out: How many things (faces, samples, views, shapes) each skip has spared.
        of: Of how many.
        rasterised: Views whose faces were drawn.
    """

    left_out: Counter[str] = field(default_factory=Counter)
    of: Counter[str] = field(default_factory=Counter)
    rasterised: int = 0

    def count(self, name: str, left_out: int, of: int) -> None:
        """Add to one skip."""
        self.left_out[name] += int(left_out)
        self.of[name] += int(of)

    def add_views(self, counts: np.ndarray, asked: int) -> None:
        """Add what the kernels counted, (N, COUNTERS), for N views that stand for `asked` ones."""
        total = counts.sum(axis=0)
        faces = total[skips.SEEN]
        self.rasterised += len(counts)
        self.count("frustum", total[skips.OUTSIDE], faces)
        self.count("backface", total[skips.BEHIND_SOLID], faces)
        self.count("no-sample", total[skips.COVERS_NOTHING], faces)
        self.count("occluded", total[skips.HIDDEN], faces)
        self.count("near-clip", faces - total[skips.CLIPPED], faces)
        self.count("background", total[skips.EMPTY_SAMPLES], total[skips.SAMPLES])
        self.count("same-view", asked - len(counts), asked)

    def clear(self) -> None:
        """Begin anew."""
        self.left_out.clear()
        self.of.clear()
        self.rasterised = 0


_TALLY = Tally()


def tally() -> Tally:
    """The tally of this process."""
    return _TALLY
