"""Which data set was preprocessed last in a folder."""

from __future__ import annotations

import os
from pathlib import Path

from mvtn_cli.core.preprocess.settings import Settings
from mvtn_cli.core.store import Store, digest


def remember_last(store: Store, spec: str, settings: Settings) -> None:
    """Note that `spec` was preprocessed in the current folder."""
    document = {"folder": str(Path.cwd()), "spec": spec, "settings": settings.as_dict()}
    store.write_index(_name(), document)


def recall_last(store: Store) -> tuple[str, Settings] | None:
    """Return the data set preprocessed last in the current folder, and how; None if none is known."""
    document = store.read_index(_name())
    try:
        return (str(document["spec"]), Settings.from_dict(document["settings"])) if document else None
    except (KeyError, TypeError, ValueError):
        return None


def _name() -> str:
    return f"last/{digest(os.fsencode(Path.cwd()))[:20]}"
