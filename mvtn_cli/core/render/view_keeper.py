"""Fixed views are seen once and painted ever after: who keeps them, in memory and in the artifact store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from hashlib import blake2b
from pathlib import Path

import numba
import numpy as np

from mvtn_cli.console import Console
from mvtn_cli.core.render import skips as bits
from mvtn_cli.core.render.batch import ShapeBatch, pack
from mvtn_cli.core.render.kept_views import KeptViews, trim
from mvtn_cli.core.render.look import Look
from mvtn_cli.core.render.mesh import SAMPLES_AT_ONCE, MeshScene
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.store import Store, StoredShape, digest
from mvtn_cli.core.store.shape_file import DamagedFile
from mvtn_cli.core.store.views_file import read_views, write_views
from mvtn_cli.errors import MvtnError

IN_MEMORY = 1 << 30  # bytes of views that one keeper holds; the others are read from the store each time
# What is seen depends on these skips (a sample in a thousand, or how large the box is), what is painted on none.
SEEING = bits.FRUSTUM | bits.BACKFACE | bits.NO_SAMPLE | bits.OCCLUDED | bits.BACKGROUND | bits.NEAR_CLIP
FORMAT = "1"


@cache
def seeing_version() -> str:
    """Digest of the sources that decide what is seen: an edited renderer must not paint from older views."""
    state = blake2b(f"{FORMAT} {numba.__version__}".encode(), digest_size=16)
    folder = Path(__file__).parent
    for name in ("batch", "edges", "kept_views", "mesh", "raster", "solids", "surface", "topology", "view", "walking"):
        state.update((folder / f"{name}.py").read_bytes())
    return state.hexdigest()


def views_address(shape: str, rts: np.ndarray, look: Look, fov_deg: float, skips: int) -> str:
    """Content address of what the cameras (M, 3, 4) see of a shape; colours and lights are no part of it."""
    settings = f"{look.image_size} {look.supersample} {look.shading} {fov_deg!r} {skips & SEEING}"
    return digest(seeing_version(), shape, np.ascontiguousarray(rts, np.float64).tobytes(), settings)


@dataclass
class ViewKeeper:
    """Keeps views in memory until `budget` bytes are full, and all of them in the store.

    No eviction: an epoch asks for every shape once, so that anything evicted for a newcomer would be missed as soon.

    Attributes:
        store: None keeps in memory alone.
        console: Where damaged files are named, and, once, that the store can't be written.
        budget: Bytes.
    """

    store: Store | None
    console: Console = field(repr=False)
    budget: int = IN_MEMORY
    views: dict[str, KeptViews] = field(default_factory=dict, repr=False)
    used: int = 0
    writes: bool = True

    def find(self, address: str, name: str) -> KeptViews | None:
        """Return the views of `address`, or None: then they have to be seen (again, if a file is damaged)."""
        found = self.views.get(address)
        if found is not None or self.store is None:
            return found
        try:
            arrays = read_views(self.store, address)
            found = None if arrays is None else KeptViews.of(arrays)
        except (DamagedFile, KeyError):
            self.console.warn(f"the stored views of {name} are damaged; they are made again")
            return None
        if found is not None:
            self._remember(address, found)
        return found

    def keep(self, address: str, views: KeptViews) -> None:
        """Keep new views; where the store can't be written, that is said once and work goes on."""
        self._remember(address, views)
        if self.store is None or not self.writes:
            return
        try:
            write_views(self.store, address, views.arrays)
        except MvtnError as error:
            self.writes = False
            self.console.warn(f"views are not stored, and are drawn again when they are needed: {error.message}")

    def _remember(self, address: str, views: KeptViews) -> None:
        if address not in self.views and self.used + views.nbytes <= self.budget:
            self.views[address] = views
            self.used += views.nbytes


@dataclass(frozen=True)
class KeptBatch(ShapeBatch):
    """A batch of meshes whose views are kept: they are packed only where something has to be seen after all.

    Attributes:
        shapes: B shapes.
        addresses: Their B content addresses.
        keeper: Who keeps their views.
    """

    shapes: tuple[StoredShape, ...] = ()
    addresses: tuple[str, ...] = ()
    keeper: ViewKeeper | None = None

    @property
    def has_meshes(self) -> bool:
        """Always: others are not made into such a batch."""
        return True

    def packed(self) -> ShapeBatch:
        """Return the batch as if nothing were kept."""
        whole = pack(self.shapes, labels=self.labels.tolist(), names=self.names)
        return whole.with_points(self.points)


def kept_batch(
    shapes: Sequence[StoredShape],
    addresses: Sequence[str],
    keeper: ViewKeeper,
    labels: Sequence[int] | None = None,
    names: Sequence[str] | None = None,
) -> KeptBatch:
    """Like `pack`, for meshes that are drawn from the same cameras again and again.

    Raises:
        DataError: As `pack`.
    """
    points_only = pack([_hollow(shape) for shape in shapes], labels, names)
    return KeptBatch(**points_only.__dict__, shapes=tuple(shapes), addresses=tuple(addresses), keeper=keeper)


def _hollow(shape: StoredShape) -> StoredShape:
    """Return the shape without its mesh, made once and kept with it for as long as it is in memory."""
    known = shape.__dict__.get("_hollow")
    if known is None:
        nothing = np.zeros((0, 3), np.float32)
        known = StoredShape(
            vertices=nothing,
            faces=np.zeros((0, 3), np.int32),
            normals=nothing,
            colors=None,
            points=shape.points,
            point_colors=shape.point_colors,
            center=shape.center,
            radius=shape.radius,
        )
        object.__setattr__(shape, "_hollow", known)
    return known


def kept_images(batch: KeptBatch, rts: np.ndarray, look: Look, fov_deg: float, skips: int) -> np.ndarray:
    """Draw (B, M, 3, 4) cameras: (B, M, 3, H, W) float32, and see no view that is kept."""
    assert batch.keeper is not None
    names = batch.names or ("a shape",) * len(batch)
    rows = zip(batch.addresses, rts, strict=True)
    addresses = [views_address(shape, cameras, look, fov_deg, skips) for shape, cameras in rows]
    found = {address: batch.keeper.find(address, name) for address, name in zip(addresses, names, strict=True)}
    missing = [b for b, address in enumerate(addresses) if found[address] is None]
    tally().count("fixed-views", (len(batch) - len(missing)) * rts.shape[1], rts[..., 0, 0].size)
    side = look.image_size * look.supersample
    at_once = max(1, SAMPLES_AT_ONCE // (side * side * max(1, rts.shape[1])))
    for start in range(0, len(missing), at_once):
        chunk = missing[start : start + at_once]
        for b, seen in zip(chunk, _see(batch, chunk, rts, look, fov_deg, skips), strict=True):
            found[addresses[b]] = seen
            batch.keeper.keep(addresses[b], seen)
    scene = MeshScene(batch, look, fov_deg, skips)
    kept = [views for address in addresses if (views := found[address]) is not None]
    return scene.paint_kept(kept).reshape(*rts.shape[:2], 3, look.image_size, look.image_size)


def _see(
    batch: KeptBatch, chunk: Sequence[int], rts: np.ndarray, look: Look, fov_deg: float, skips: int
) -> list[KeptViews]:
    """See some shapes of the batch; those with and without colours apart, so that none is tinted needlessly."""
    seen: dict[int, KeptViews] = {}
    for tinted in (False, True):
        alike = [b for b in chunk if (batch.shapes[b].colors is not None) == tinted]
        if alike:
            # Colours and lights of the look are of all B shapes, and seeing asks for neither.
            scene = MeshScene(pack([batch.shapes[b] for b in alike]), look, fov_deg, skips)
            seen.update(zip(alike, trim(scene.see(rts[alike])), strict=True))
    return [seen[b] for b in chunk]
