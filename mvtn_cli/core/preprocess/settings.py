"""What decides how a stored shape comes out, and so its address."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from mvtn_cli.config import PreprocessConfig
from mvtn_cli.core.store import digest

STAGE = "preprocess 4"  # count up whenever the same input would come out differently


@dataclass(frozen=True)
class Settings:
    """The options of `mvtn preprocess` that change a stored shape.

    Attributes:
        max_vertices: Meshes with more vertices are simplified.
        num_points: Points stored of each shape.
        seed: Mixed into the seed of each shape's points.
    """

    max_vertices: int
    num_points: int
    seed: int

    @classmethod
    def of(cls, config: PreprocessConfig) -> Settings:
        """Take the settings out of a command's config."""
        return cls(config.max_vertices, config.num_points, config.seed)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Settings:
        """Build settings from `as_dict`."""
        return cls(*(int(values[name]) for name in ("max_vertices", "num_points", "seed")))

    def as_dict(self) -> dict[str, int]:
        """Return the settings by name."""
        return asdict(self)

    def address(self, content: bytes) -> str:
        """Return the content address of what these settings make of `content`."""
        return digest(content, self.key())

    def index_name(self, spec: str) -> str:
        """Return the name of the index of a data set under these settings."""
        return digest(spec, self.key())[:20]

    def key(self) -> str:
        """Return stage and settings as one canonical line."""
        return f"{STAGE} {json.dumps(self.as_dict(), sort_keys=True)}"
