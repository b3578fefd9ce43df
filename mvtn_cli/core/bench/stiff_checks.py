"""What else must hold in a stiff scene, beyond finite numbers. Each check says what is wrong, or nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from mvtn_cli.core.bench.timing import most_threads, threads
from mvtn_cli.core.render import Look, pack, render
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.views import Cameras, camera_rotations

ALIKE = 1e-4  # mean difference of two pictures a thousandth of a degree apart; their edges move by 1/200 px
STEADY = 1e-2  # difference of the angles' gradients there, of their size
OTHER_DIAGONAL = ((0, 1, 3), (1, 2, 3))  # of a square of corners 0, 1, 2, 3
SAME = 2e-2  # mean difference, times image side, of pictures that should be equal: what differs lies on outlines


@dataclass(frozen=True)
class Seen:
    """What came out of one stiff scene.

    Attributes:
        shape: What was drawn.
        cameras: (1, M).
        look: How.
        images: (M, 3, H, W).
        gradient: (M, 3) by azimuth, elevation and distance.
    """

    shape: StoredShape
    cameras: Cameras
    look: Look
    images: np.ndarray
    gradient: np.ndarray


Check: TypeAlias = Callable[[Seen], str]


def nothing_more(seen: Seen) -> str:
    """Finite numbers are enough."""
    return ""


def all_views_alike(seen: Seen) -> str:
    """Views that are (almost) one view have (almost) one picture and one gradient."""
    picture = max(float(np.abs(image - seen.images[0]).mean()) for image in seen.images)
    if picture > ALIKE:
        return f"pictures differ by {picture:.2g}"
    angles = seen.gradient[:, :2]
    slope = float(np.abs(angles - angles[0]).max() / max(np.abs(angles[0]).max(), 1e-30))
    return f"gradients differ by {slope:.2g} of their size" if slope > STEADY else ""


def background(seen: Seen) -> str:
    """Nothing is seen, and nothing pulls."""
    if np.abs(seen.images).max() > 0:
        return "something is drawn"
    return "the gradient is not zero" if np.abs(seen.gradient).max() > 0 else ""


def covered(seen: Seen) -> str:
    """No pixel shows the background, which is black."""
    holes = int((seen.images.max(axis=1) <= 0).sum())
    return f"{holes} pixels show the background" if holes else ""


def every_view_has_gradient(seen: Seen) -> str:
    """White points on black pull at each camera."""
    dead = int((np.abs(seen.gradient).max(axis=1) == 0).sum())
    return f"{dead} views have no gradient" if dead else ""


def orthonormal_axes(seen: Seen) -> str:
    """Rotations are rotations."""
    rotations = camera_rotations(seen.cameras.azimuth_deg[0], seen.cameras.elevation_deg[0]).numpy()
    error = float(np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max())
    if error > 1e-12:
        return f"axes are off by {error:.2g}"
    return "a rotation mirrors" if np.linalg.det(rotations).min() < 0 else ""


def look_at(seen: Seen) -> str:
    """The closed form is that of a look-at with y up."""
    rotations = camera_rotations(seen.cameras.azimuth_deg[0], seen.cameras.elevation_deg[0]).numpy()
    for rotation in rotations:
        backward = rotation[2]
        right = np.cross([0, 1, 0], backward)
        right /= np.linalg.norm(right)
        wanted = np.stack([right, np.cross(backward, right), backward])
        if np.abs(wanted - rotation).max() > 1e-12:
            return f"axes are off by {np.abs(wanted - rotation).max():.2g}"
    return orthonormal_axes(seen)


def same_for_any_threads(seen: Seen) -> str:
    """One thread draws the same bytes as all."""
    pictures = []
    for count in {1, most_threads()}:
        with threads(count):
            pictures.append(_picture(seen.shape, seen))
    return "" if all((picture == pictures[0]).all() for picture in pictures) else "depends on the number of threads"


def each_sample_once(seen: Seen) -> str:
    """Of a square's two halves each sample sees exactly one, and the other diagonal covers the same samples."""
    halves = [_covered_by(seen, seen.shape.faces[face : face + 1]) for face in (0, 1)]
    other = _covered_by(seen, np.array(OTHER_DIAGONAL, np.int32))
    twice, missed = int((halves[0] & halves[1]).sum()), int((other & ~halves[0] & ~halves[1]).sum())
    return f"{twice} samples are covered twice, {missed} not at all" if twice or missed else ""


def same_picture_as(shape: Callable[[], StoredShape]) -> Check:
    """The picture is that of another, well-behaved shape."""

    def compare(seen: Seen) -> str:
        difference = float(np.abs(_picture(shape(), seen) - seen.images).mean())
        return f"the picture differs by {difference:.2g}" if difference * seen.look.image_size > SAME else ""

    return compare


def _picture(shape: StoredShape, seen: Seen) -> np.ndarray:
    return render(pack([shape]), seen.cameras, seen.look, gradient="none").rgb[0].numpy()


def _covered_by(seen: Seen, faces: np.ndarray) -> np.ndarray:
    """Where (M, H, W) these faces of the shape are seen."""
    batch = pack([replace(seen.shape, faces=np.ascontiguousarray(faces))])
    ids = render(batch, seen.cameras, seen.look, gradient="none", outputs=("geometry",)).face_ids
    assert ids is not None
    return ids[0] >= 0
