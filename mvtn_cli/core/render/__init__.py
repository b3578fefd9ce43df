"""Differentiable images of shapes: `render(batch, cameras, look)`."""

from mvtn_cli.core.render.batch import ShapeBatch, pack
from mvtn_cli.core.render.look import MATERIALS, Look, check_look
from mvtn_cli.core.render.scene import GRADIENTS, Images, render

__all__ = ["GRADIENTS", "MATERIALS", "Images", "Look", "ShapeBatch", "check_look", "pack", "render"]
