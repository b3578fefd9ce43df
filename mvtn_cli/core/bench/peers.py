"""Other differentiable renderers on this machine."""

from __future__ import annotations

from importlib import import_module, metadata

PEERS = ("pytorch3d", "mitsuba", "nvdiffrast")


def peers() -> list[dict[str, str]]:
    """Each peer that was not measured, and why."""
    return [{"what": name, "reason": why_omitted(name)} for name in PEERS]


def why_omitted(name: str) -> str:
    """Why this peer has no row."""
    try:
        import_module(name)
    except ImportError as error:
        return f"can't be imported: {error}"
    except Exception as error:  # a build for another torch raises anything
        return f"breaks on import: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
    return f"{_version(name)} is here, but mvtn can't drive it yet"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "a copy without a version"
