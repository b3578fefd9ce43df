"""How a trained run stands shapes that are turned, cut, noisy, thinned out or of another size."""

from mvtn_cli.core.robustness.corruption import Corruption, shape_generator
from mvtn_cli.core.robustness.occlusion import CROPS, DIRECTIONS, Corrupted, occlude
from mvtn_cli.core.robustness.served import CorruptedShapes

__all__ = [
    "CROPS",
    "DIRECTIONS",
    "Corrupted",
    "CorruptedShapes",
    "Corruption",
    "occlude",
    "shape_generator",
]
