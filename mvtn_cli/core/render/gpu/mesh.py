"""Images of batches of meshes on a CUDA device, and their gradient: nothing goes through main memory but the shapes.

What a gradient needs is kept as face ids alone, 4 bytes a sample; backward makes the rest again, a few views at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from mvtn_cli.core.render.batch import ShapeBatch
from mvtn_cli.core.render.gpu import painting, seeing
from mvtn_cli.core.render.gpu.compiled import QUEUE_BLOCKS, THREADS, launch
from mvtn_cli.core.render.look import Look
from mvtn_cli.core.render.mesh import focal_pixels
from mvtn_cli.core.render.skips import BACKFACE, EVERYTHING

# Bytes of buffers that are held at once, at least one view's; most views of a launch; what each sample, vertex and face
# of a view takes.
HELD, MOST_VIEWS = 1 << 30, 65_535
SAMPLE_BYTES, VERTEX_BYTES, FACE_BYTES = 80, 32, 8


@dataclass(frozen=True)
class Part:
    """Some views, N of S x S samples, and their buffers on the device.

    Attributes:
        number: N.
        rts, shape_of: (N, 3, 4) float64 and (N,) int64.
        starts: (N + 1,) int64: where each view's vertices begin.
        camera, screen: Of `raster.project`, one view after another.
        most_vertices, most_faces: Of the largest shape.
        all_faces: Of all views together.
        ids, depth, normals, tints, planes, sharp: What is seen, (N, S, S, ...); tints are (N, 1, 1, 3) without colours.
    """

    number: int
    rts: torch.Tensor
    shape_of: torch.Tensor
    starts: torch.Tensor
    camera: torch.Tensor
    screen: torch.Tensor
    most_vertices: int
    most_faces: int
    all_faces: int
    ids: torch.Tensor
    depth: torch.Tensor
    normals: torch.Tensor
    tints: torch.Tensor
    planes: torch.Tensor
    sharp: torch.Tensor

    @property
    def views(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """What kernels take of the cameras."""
        return self.rts, self.shape_of, self.starts


class GpuMeshScene:
    """A batch and a look on a device, ready to be drawn from any cameras."""

    def __init__(
        self, batch: ShapeBatch, look: Look, fov_deg: float, device: torch.device, skips: int = EVERYTHING
    ) -> None:
        self.look, self.skips, self.device = look, skips, device
        self.size, self.side = look.image_size, look.image_size * look.supersample
        self.focal = focal_pixels(look.image_size, fov_deg) * look.supersample
        self.smooth = look.shading == "smooth"
        self.vertex_counts, self.face_counts = np.diff(batch.offsets[0]), np.diff(batch.offsets[1])
        self.tint_side = self.side if len(batch.colors) else 0
        self.colors = self._put(batch.colors if len(batch.colors) else np.zeros((1, 3), np.float32))
        self.vertices, self.normals, self.faces = (self._put(a) for a in (batch.vertices, batch.normals, batch.faces))
        self.topology = [
            self._put(a) for a in (batch.face_edges, batch.edge_starts, batch.edge_faces, batch.creases)
        ]  # fmt: skip
        self.solid, self.radii, self.offsets = (self._put(a) for a in (batch.solid, batch.radii, batch.offsets))
        light = look.light_direction
        self.lights = self._put(np.zeros((len(batch), 3)) if light is None else light.astype(np.float64))
        self.albedos = self._put(look.colors.astype(np.float64))
        self.material, self.background = self._put(look.material), self._put(np.array(look.background, np.float64))
        self.box = self._put(np.array([0, self.side - 1, 0, self.side - 1]))

    def _put(self, array: np.ndarray) -> torch.Tensor:
        # A copy that waits would wait for all that the device has still to do.
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device, non_blocking=True)

    def _empty(self, *shape: int, dtype: torch.dtype = torch.float32) -> torch.Tensor:
        return torch.empty(shape, dtype=dtype, device=self.device)

    def parts(self, shape_of: np.ndarray) -> Iterator[slice]:
        """Views that fit into HELD bytes, of shapes `shape_of` (N,), one slice after another."""
        need = self.side**2 * SAMPLE_BYTES + VERTEX_BYTES * self.vertex_counts + FACE_BYTES * self.face_counts
        start, held = 0, 0
        for view, wanted in enumerate(need[shape_of]):
            if view > start and (held + wanted > HELD or view - start == MOST_VIEWS):
                yield slice(start, view)
                start, held = view, 0
            held += wanted
        if len(shape_of) > start:
            yield slice(start, len(shape_of))

    def see(self, rts: torch.Tensor, shape_of: np.ndarray, ids: torch.Tensor | None = None) -> Part:
        """See N cameras (N, 3, 4); what faces they see is looked for unless `ids` has it."""
        number, side = len(rts), self.side
        starts = np.concatenate([[0], np.cumsum(self.vertex_counts[shape_of])])
        total, tint = int(starts[-1]), max(1, self.tint_side)
        part = Part(
            number=number,
            rts=rts,
            shape_of=self._put(shape_of),
            starts=self._put(starts),
            camera=self._empty(total, 3, dtype=torch.float64),
            screen=self._empty(total, 2, dtype=torch.int32),
            most_vertices=int(self.vertex_counts[shape_of].max(initial=0)),
            most_faces=int(self.face_counts[shape_of].max(initial=0)),
            all_faces=int(self.face_counts[shape_of].sum()),
            ids=self._empty(number, side, side, dtype=torch.int32).fill_(seeing.NOTHING) if ids is None else ids,
            depth=torch.zeros((number, side, side), dtype=torch.float64, device=self.device),
            normals=self._empty(number, side, side, 3),
            tints=self._empty(number, tint, tint, 3),
            planes=self._empty(number, side, side, 2),
            sharp=self._empty(number, side, side, dtype=torch.uint8),
        )
        launch(
            seeing.project_views, number, part.most_vertices, self.vertices, self.offsets, *part.views, self.focal,
            side, part.camera, part.screen,
        )  # fmt: skip
        if ids is None:
            self._find_faces(part)
        launch(
            seeing.describe_views, number, side * side, self.normals, self.colors, self.faces, self.topology[3],
            self.offsets, *part.views, part.camera, part.screen, self.focal, self.smooth, self.tint_side > 0, part.ids,
            part.depth, part.normals, part.tints, part.planes, part.sharp,
        )  # fmt: skip
        return part

    def _find_faces(self, part: Part) -> None:
        """Fill the ids; `depth` holds each sample's greatest 1/z meanwhile."""
        doubt = torch.zeros(part.ids.shape, dtype=torch.uint8, device=self.device)
        queue = self._empty(part.all_faces, dtype=torch.int64)
        queued = torch.zeros(1, dtype=torch.int64, device=self.device)
        culled = bool(self.skips & BACKFACE)
        scene = (
            self.faces, self.solid, self.radii, self.offsets, *part.views, part.camera, part.screen, self.focal, culled,
        )  # fmt: skip
        for second in (False, True):
            found = (second, part.depth, part.ids, doubt, part.most_faces, queue, queued)
            launch(seeing.seek_small, part.number, part.most_faces, *scene, *found)
            launch(seeing.seek_large, 1, QUEUE_BLOCKS * THREADS, *scene, *found)
        launch(seeing.settle, part.number, self.side**2, *scene, part.depth, part.ids, doubt)

    def _paint(self, part: Part) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the samples' colours, links and moves of a part."""
        number, side = part.number, self.side
        links, moves = self._empty(number, side, side, dtype=torch.uint8), self._empty(number, side, side, 2, 2)
        images = self._empty(number, side, side, 3)
        launch(
            painting.find_jumps, number, side * side, self.faces, *self.topology, self.offsets, part.shape_of,
            part.starts, part.camera, self.focal, self.smooth, part.ids, part.depth, part.planes, part.sharp,
            part.normals, links, moves,
        )  # fmt: skip
        launch(
            painting.paint_views, number, side * side, part.rts, part.shape_of, self.focal, self.lights, self.albedos,
            self.material, self.background, self.skips, self.tint_side, part.depth, part.normals, part.tints, images,
        )  # fmt: skip
        return images, links, moves

    def draw(self, matrices: torch.Tensor, *, keep: bool) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Return the images (B, M, 3, H, W) float32 of (B, M, 3, 4) cameras, and the face ids (B * M, S, S) to keep."""
        rts, shape_of = _flat(matrices)
        out = self._empty(len(rts), 3, self.size, self.size)
        ids = self._empty(len(rts), self.side, self.side, dtype=torch.int32) if keep else None
        for views in self.parts(shape_of):
            part = self.see(rts[views], shape_of[views])
            images, links, moves = self._paint(part)
            launch(
                painting.make_pixels, part.number, self.size**2, images, moves, links, self.background,
                self.look.supersample, out[views],
            )  # fmt: skip
            if ids is not None:
                ids[views] = part.ids
        return out.reshape(*matrices.shape[:2], *out.shape[1:]), ids

    def gradient(
        self, matrices: torch.Tensor, ids: torch.Tensor, weights: torch.Tensor, *, edges: bool = True
    ) -> torch.Tensor:
        """Return d<weights, images>/d[R|t], (B, M, 3, 4) float64, of what `draw` has drawn."""
        rts, shape_of = _flat(matrices)
        rows = weights.detach().float().reshape(-1, 3, self.size, self.size).contiguous()
        out = self._empty(len(rts), 3, 4, dtype=torch.float64)
        tasks = -(-(self.side**2) // painting.RUN)
        for views in self.parts(shape_of):
            part = self.see(rts[views], shape_of[views], ids[views])
            images, links, _ = self._paint(part)
            sums = self._empty(part.number, -(-tasks // THREADS), painting.TERMS, dtype=torch.float64)
            launch(
                painting.sum_slopes, part.number, tasks, self.faces, *self.topology, self.offsets, *part.views,
                part.camera, self.focal, self.smooth, part.ids, part.depth, part.planes, part.sharp, part.normals,
                links, self.tint_side, part.tints, images, self.lights, self.albedos, self.material, self.box,
                self.look.supersample, edges, rows[views], sums,
            )  # fmt: skip
            launch(
                painting.turn_to_cameras, part.number, 1, part.rts, part.shape_of, self.lights, self.look.supersample,
                sums.sum(dim=1), out[views],
            )  # fmt: skip
        return out.reshape(matrices.shape)

    def geometry(self, matrices: torch.Tensor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return face ids (B,M,H,W) int32, depth (B,M,H,W) and world normals (B,M,3,H,W) of all samples."""
        rts, shape_of = _flat(matrices)
        found = []
        for views in self.parts(shape_of):
            part = self.see(rts[views], shape_of[views])
            covered = part.ids >= 0
            depth = torch.where(covered, 1.0 / part.depth, 0.0).float()
            normals = torch.where(covered[..., None], part.normals, 0.0).permute(0, 3, 1, 2)
            found.append([array.cpu().numpy() for array in (part.ids, depth, normals)])
        lead = matrices.shape[:2]
        ids, depths, normal_images = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
        return (
            ids.reshape(*lead, *ids.shape[1:]),
            depths.reshape(*lead, *depths.shape[1:]),
            np.ascontiguousarray(normal_images.reshape(*lead, *normal_images.shape[1:])),
        )


def _flat(matrices: torch.Tensor) -> tuple[torch.Tensor, np.ndarray]:
    """Return (B * M, 3, 4) cameras and the shape of each."""
    shapes, views = matrices.shape[:2]
    return matrices.detach().reshape(-1, 3, 4).contiguous(), np.repeat(np.arange(shapes), views)


class GpuEdgeFlow(torch.autograd.Function):
    """Images (B,M,3,H,W) from matrices (B,M,3,4) float64, both on the device; as `mesh.EdgeFlow`."""

    @staticmethod
    def forward(ctx, matrices, scene: GpuMeshScene, edges: bool):
        """Draw every (shape, camera) pair."""
        images, ids = scene.draw(matrices, keep=ctx.needs_input_grad[0])
        ctx.scene, ctx.edges = scene, edges
        ctx.save_for_backward(matrices, ids)
        return images

    @staticmethod
    def backward(ctx, grad):
        """Reduce straight to each view's [R|t]."""
        matrices, ids = ctx.saved_tensors
        return ctx.scene.gradient(matrices, ids, grad, edges=ctx.edges), None, None
