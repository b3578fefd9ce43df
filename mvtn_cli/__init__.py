"""Multi-view 3D shape recognition that chooses its own cameras."""

__version__ = "0.1.0"
