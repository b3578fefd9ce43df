"""One corruption of a whole data set: what is done, how strongly, and from which seed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from mvtn_cli.core.robustness.disturbing import scaled, with_noise, without_points
from mvtn_cli.core.robustness.occlusion import Corrupted, occlude
from mvtn_cli.core.robustness.turning import draw_angle, draw_rotation, turn_about_y, turned
from mvtn_cli.core.store import StoredShape, digest

Kind = Literal["clean", "rotate", "so3", "occlude", "noise", "drop-points", "scale"]


@dataclass(frozen=True)
class Corruption:
    """What is done to every shape.

    Attributes:
        kind: clean does nothing.
        strength: rotate: largest angle, degrees; occlude: ratio; noise: standard deviation, radii; drop-points: share;
            scale: factor; 0 for clean and so3, which have none.
        direction: Of an occlusion, as `+x`; else empty.
        crop: Of an occlusion, as `quantile`; else empty.
        repeat: Which of the repeats of something random, from 0.
        seed: Of everything random; 0 where nothing is.
    """

    kind: Kind
    strength: float = 0.0
    direction: str = ""
    crop: str = ""
    repeat: int = 0
    seed: int = 0

    @property
    def variant(self) -> str:
        """What tells it from others of its kind and strength: the direction, or the repeat."""
        return self.direction or str(self.repeat)

    def as_dict(self) -> dict[str, Any]:
        """Its fields, as a cell's record holds them."""
        return asdict(self)

    def apply(self, shape: StoredShape, name: str) -> Corrupted:
        """Corrupt one shape.

        Args:
            shape: As stored; it is not changed.
            name: Its name in the data set: with the seed and the repeat, all that chance depends on.
        """
        random = shape_generator(self.seed, self.repeat, name)
        match self.kind:
            case "rotate":
                return Corrupted(turned(shape, turn_about_y(draw_angle(self.strength, random))))
            case "so3":
                return Corrupted(turned(shape, draw_rotation(random)))
            case "occlude":
                return occlude(shape, self.strength, self.direction, self.crop)
            case "noise":
                return Corrupted(with_noise(shape, self.strength, random))
            case "drop-points":
                return without_points(shape, self.strength, random)
            case "scale":
                return Corrupted(scaled(shape, self.strength))
            case _:
                return Corrupted(shape)


def shape_generator(seed: int, repeat: int, name: str) -> np.random.Generator:
    """The generator of one shape in one repeat: neither batch, order nor the other shapes matter.

    Nor does the strength, so that a curve over strengths is not rougher than it must be.
    """
    return np.random.default_rng([seed, repeat, int(digest(name)[:16], 16)])
