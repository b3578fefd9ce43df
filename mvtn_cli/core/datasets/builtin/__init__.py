"""Data sets that are made on the spot: `builtin:shapes` and `builtin:one-sided`."""

from mvtn_cli.core.datasets.builtin.opening import open_builtin

__all__ = ["open_builtin"]
