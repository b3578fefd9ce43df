"""A trained recogniser as files that other programs read: ONNX, weights, labels, a model card."""

from mvtn_cli.core.export.export import export_run

__all__ = ["export_run"]
