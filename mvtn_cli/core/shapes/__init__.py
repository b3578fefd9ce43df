"""What a shape is: read, validate, normalise, simplify, sample."""

from mvtn_cli.core.shapes.creases import split_creases
from mvtn_cli.core.shapes.normalise import normalise
from mvtn_cli.core.shapes.normals import vertex_normals
from mvtn_cli.core.shapes.reading import SUFFIXES, read_shape
from mvtn_cli.core.shapes.sample import sample_surface
from mvtn_cli.core.shapes.shape import Shape, cloud, turn_y_up
from mvtn_cli.core.shapes.simplify import Simplification, simplify
from mvtn_cli.core.shapes.validate import Finding, validate

__all__ = [
    "SUFFIXES",
    "Finding",
    "Shape",
    "Simplification",
    "cloud",
    "normalise",
    "read_shape",
    "sample_surface",
    "simplify",
    "split_creases",
    "turn_y_up",
    "validate",
    "vertex_normals",
]
