"""The settings that decide what the networks are, taken from a configuration or from a run's file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, Self


class _Settings:
    """Named values with defaults, filled from anything that has fields of these names."""

    @classmethod
    def of(cls, config: Any) -> Self:
        """Those of the fields that a configuration has; the others are as here."""
        names = [field.name for field in fields(cls) if hasattr(config, field.name)]  # type: ignore[arg-type]
        return cls(**{name: getattr(config, name) for name in names})

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Self:
        """The same from a mapping, as a run's `config.toml` is read; other keys are left alone."""
        names = [field.name for field in fields(cls) if field.name in values]  # type: ignore[arg-type]
        return cls(**{name: values[name] for name in names})


@dataclass(frozen=True)
class SelectorSettings(_Settings):
    """Of the selection of views.

    Attributes:
        views: fixed, jittered, random, learned-direct, learned-circular, learned-spherical, learned-random or
            transferred.
        layout, num_views, azimuth, elevation: Where fixed cameras stand and learned ones start.
        distance, fov: Of all cameras.
        angles: Form of learned-direct: periodic or tanh.
        encoder, tnets: Point encoder, as for `build_encoder`.
        regressor: From features to angles: small or reference (the released code's).
        learn_distance: Largest factor by which a learned distance differs from `distance`; 1 learns none.
        learn_light: Whether the light is learned, too.
        encoder_points: Points that the encoder sees.
    """

    views: str = "fixed"
    layout: str = "spherical"
    num_views: int = 6
    azimuth: float = 0.0
    elevation: float = 30.0
    distance: float = 2.2
    fov: float = 60.0
    angles: str = "periodic"
    encoder: str = "small"
    tnets: bool = False
    regressor: str = "small"
    learn_distance: float = 1.0
    learn_light: bool = False
    encoder_points: int = 512

    @property
    def start_layout(self) -> str:
        """Name of the layout that the views are at, or start from."""
        named = self.views in ("learned-circular", "learned-spherical")
        return self.views.removeprefix("learned-") if named else self.layout

    @property
    def starts_at_random(self) -> bool:
        """Whether there is no such layout."""
        return self.views in ("random", "learned-random")


@dataclass(frozen=True)
class ClassifierSettings(_Settings):
    """Of the network that classifies.

    Attributes:
        network: mvcnn, rotationnet, viewgcn; pointnet or dgcnn, which look at points alone.
        pool: Of mvcnn: max or mean.
        graph_width: Of viewgcn's features; None is the backbone's, at most 512.
        fuse: Late fusion with a point encoder of its own, `encoder` and `tnets`.
        encoder, tnets: As for `build_encoder`; `tnets` also goes for the network pointnet.
        first_stage_epochs: Epochs in which each picture is classified by itself; 0 for none.
        backbone, weights, freeze_backbone: Of the pictures.
    """

    network: str = "mvcnn"
    pool: Literal["max", "mean"] = "max"
    graph_width: int | None = None
    fuse: bool = False
    encoder: str = "small"
    tnets: bool = False
    first_stage_epochs: int = 0
    backbone: str = "tiny"
    weights: str | Path = "none"
    freeze_backbone: bool = False
