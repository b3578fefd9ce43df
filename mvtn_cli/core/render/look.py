"""Everything in the picture that is neither shape nor camera: light, colour, background, size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch

from mvtn_cli.errors import UsageError

WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
# (ambient, diffuse, specular, shininess, falloff). `studio` has contrast and no highlight, so the renderer skips that
# term; `relief` is darker on slopes and tells shallow relief apart; `paper` is what the released code inherits from
# PyTorch3D's defaults.
MATERIALS = {
    "studio": (0.1, 0.9, 0.0, 64.0, 2.0),
    "relief": (0.1, 0.9, 0.0, 64.0, 4.0),
    "paper": (0.5, 0.3, 0.2, 64.0, 1.0),
}


class LookSettings(Protocol):
    """The fields of a configuration that decide about the look."""

    @property
    def image_size(self) -> int: ...
    @property
    def look(self) -> str: ...
    @property
    def color(self) -> str: ...
    @property
    def light(self) -> str: ...
    @property
    def shading(self) -> str: ...
    @property
    def supersample(self) -> int: ...
    @property
    def point_radius(self) -> float: ...
    @property
    def depth_cue(self) -> float: ...


@dataclass(frozen=True)
class Look:
    """How B shapes are lit and drawn.

    Attributes:
        image_size: Height and width in pixels.
        kind: "mesh" or "points".
        colors: (B, 3) float32 in [0, 1], multiplied with vertex or point colours where there are some.
        light_direction: (B, 3) float32 unit vectors towards the light, world frame; None, or a row of zeros, is a
            headlight.
        background: RGB in [0, 1].
        ambient, diffuse, specular, shininess, falloff: Of the one light, see `shade.py`; points have none.
        shading: "smooth" (interpolated normals) or "flat".
        supersample: Samples per pixel along each axis.
        point_radius: World radius of a point's disc, in shape radii: one for all, (B,) for each shape or (B, P) for
            each point; a point of radius 0 is not seen.
        depth_cue: Share of its light that a drawn point loses from one shape radius before the centre to one behind.
    """

    image_size: int
    kind: str
    colors: np.ndarray
    light_direction: np.ndarray | None = None
    background: tuple[float, float, float] = BLACK
    ambient: float = 0.1
    diffuse: float = 0.9
    specular: float = 0.0
    shininess: float = 64.0
    falloff: float = 2.0
    shading: str = "smooth"
    supersample: int = 2
    point_radius: float | np.ndarray = 0.02
    depth_cue: float = 0.0

    @property
    def material(self) -> np.ndarray:
        """The row (ambient, diffuse, specular, shininess, falloff) that the kernels take."""
        return np.array([self.ambient, self.diffuse, self.specular, self.shininess, self.falloff])

    def point_radii(self, count: int, points: int) -> np.ndarray:
        """Return (B, P) float64: the radius of each of P points of B shapes.

        Raises:
            ValueError: Radii for other shapes or points, negative or not finite.
        """
        given = np.asarray(self.point_radius, np.float64)
        if given.shape not in ((), (count,), (count, points)):
            raise ValueError(f"point radii are {given.shape}, the batch has {count} shapes of {points} points")
        if not (np.isfinite(given) & (given >= 0)).all():
            raise ValueError("point radii must be finite and at least 0")
        return np.ascontiguousarray(np.broadcast_to(given[:, None] if given.ndim == 1 else given, (count, points)))

    @classmethod
    def evaluation(cls, settings: LookSettings, count: int, kind: str) -> Look:
        """White shapes under a headlight (paper, section 4: the test look)."""
        return cls(colors=np.ones((count, 3), np.float32), **_common(settings, kind))

    @classmethod
    def training(cls, settings: LookSettings, count: int, kind: str, generator: torch.Generator) -> Look:
        """Random colour and light per shape, where the settings ask for them (paper, section 4).

        `mixed` takes every second shape, by chance, as in evaluation: a network that has only ever seen side light
        and colours keeps batch statistics that fit neither white nor a headlight.
        """
        as_judged = torch.rand(count, generator=generator) < 0.5
        drawn = 0.2 + 0.8 * torch.rand((count, 3), generator=generator)
        colors = drawn / drawn.amax(1, keepdim=True)
        lights = torch.randn((count, 3), generator=generator)
        lights = lights / lights.norm(dim=1, keepdim=True).clamp_min(1e-6)
        if settings.color != "random":
            colors[as_judged if settings.color == "mixed" else slice(None)] = 1.0
        if settings.light == "mixed":
            lights[as_judged] = 0.0
        light = None if settings.light == "headlight" else lights.numpy()
        return cls(colors=colors.numpy(), light_direction=light, **_common(settings, kind))


def _common(settings: LookSettings, kind: str) -> dict:
    ambient, diffuse, specular, shininess, falloff = MATERIALS[settings.look]
    return {
        "image_size": settings.image_size,
        "kind": kind,
        "background": WHITE if settings.look == "paper" and kind == "mesh" else BLACK,
        "ambient": ambient,
        "diffuse": diffuse,
        "specular": specular,
        "shininess": shininess,
        "falloff": falloff,
        "shading": settings.shading,
        "supersample": settings.supersample,
        "point_radius": settings.point_radius,
        "depth_cue": 0.0 if settings.look == "paper" else settings.depth_cue,
    }


def check_look(look: Look) -> None:
    """Refuse a look in which no shape can be seen.

    Raises:
        UsageError: Every radiance that the shape can take equals the background (white on white, zero light).
    """
    if look.kind == "points":
        low, high = look.colors.min(0), look.colors.max(0)
    else:
        low = look.ambient * look.colors.min(0)
        high = (look.ambient + look.diffuse) * look.colors.max(0) + look.specular
    background = np.asarray(look.background)
    if np.abs(low - background).max() < 1e-3 and np.abs(high - background).max() < 1e-3:
        raise UsageError(
            f"{look.kind} of this colour and light cannot be told from the background {look.background}",
            hint="choose another background, colour or light; a white shape needs a background that is not white",
            code="look.invisible",
        )
