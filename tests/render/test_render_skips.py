"""What is left out changes nothing: each skip on and off, bit for bit, over scenes that are made to catch it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from reference import scenes
from reference.drawing import cameras, matrices
from scipy.ndimage import binary_dilation
from trimesh import creation

from mvtn_cli.core.render import Look, ShapeBatch, render
from mvtn_cli.core.render.mesh import MeshScene
from mvtn_cli.core.render.skips import (
    BEHIND_SOLID,
    CLIPPED,
    COUNTERS,
    COVERS_NOTHING,
    DRAWN,
    EVERYTHING,
    HIDDEN,
    OUTSIDE,
    SEEN,
    without,
)
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.render.topology import find_topology
from mvtn_cli.core.store import StoredShape
from mvtn_cli.core.views import Cameras

KERNEL_SKIPS = (
    *("frustum", "backface", "no-sample", "occluded", "background", "near-clip", "shading-terms"),
    *("same-view", "no-gradient"),
)
AROUND = ((0.0, 0.0, 2.2), (33.0, 21.0, 1.7), (200.0, -75.0, 2.0), (90.0, 90.0, 3.0))
INSIDE = ((33.0, 21.0, 0.3), (120.0, -10.0, 0.05), (0.0, 0.0, 0.8))
TWICE = (AROUND[0], AROUND[1], AROUND[0], AROUND[1], AROUND[0])
STIFF_VIEWS = (AROUND[0], AROUND[1], (33.0, 21.0, 1.0), (200.0, -75.0, 0.3))


@dataclass(frozen=True)
class Staged:
    """Shapes, views of each, the look, and which of all views get no incoming gradient."""

    shapes: tuple[StoredShape, ...]
    views: tuple[tuple[float, float, float], ...] = AROUND
    size: int = 32
    changes: dict[str, Any] = field(default_factory=dict)
    blank: tuple[int, ...] = ()


def made(mesh: trimesh.Trimesh) -> StoredShape:
    """Return a mesh of trimesh, which winds outward."""
    return scenes.stored(mesh.vertices, mesh.faces)


def sphere(subdivisions: int, radius: float = 1.0) -> StoredShape:
    """Return a closed ball of 20 * 4^subdivisions faces."""
    return made(creation.icosphere(subdivisions, radius))


def cylinder() -> StoredShape:
    """Return a closed cylinder of 12 sides."""
    return made(creation.cylinder(0.5, 1.2, sections=12))


def mobius(count: int = 24) -> StoredShape:
    """Return a band with one half turn: every inner edge has two faces, but no winding agrees all along."""
    angle = np.arange(count) * 2 * np.pi / count
    wide = np.array([-0.3, 0.3])[None] * np.ones((count, 1))
    far = 0.6 + wide * np.cos(angle / 2)[:, None]
    points = np.stack(
        [far * np.cos(angle)[:, None], wide * np.sin(angle / 2)[:, None], far * np.sin(angle)[:, None]], -1
    )
    faces = []
    for k in range(count):
        a, b = 2 * k, 2 * k + 1
        c, d = (2 * k + 2, 2 * k + 3) if k + 1 < count else (1, 0)
        faces += [(a, b, c), (b, d, c)]
    return scenes.stored(points.reshape(-1, 3), faces)


def pentagram() -> StoredShape:
    """Return a closed figure that runs through itself: a prism over a pentagram."""
    angle = np.arange(5) * 4 * np.pi / 5
    ring = np.stack([np.sin(angle), np.zeros(5), np.cos(angle)], -1)
    k, n = np.arange(5), (np.arange(5) + 1) % 5
    faces = [
        np.stack([k, n, k + 5], -1),
        np.stack([n, n + 5, k + 5], -1),
        np.stack([np.full(5, 10), k + 5, n + 5], -1),
        np.stack([np.full(5, 11), n, k], -1),
    ]
    up = np.array([0, 0.4, 0])
    return scenes.stored(np.concatenate([ring - up, ring + up, [up, -up]]), np.concatenate(faces))


def cards(count: int, seed: int) -> StoredShape:
    """Return upright squares in random depth order: many are behind what is drawn before them."""
    random = np.random.default_rng(seed)
    middles = random.uniform(-0.4, 0.4, (count, 1, 3))
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.3
    vertices = (middles + corners).reshape(-1, 3)
    return scenes.stored(vertices, (4 * np.arange(count)[:, None, None] + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3))


def colored(shape: StoredShape) -> StoredShape:
    """Return the shape with a colour at each vertex."""
    colors = np.random.default_rng(2).uniform(0, 1, shape.vertices.shape)
    return scenes.stored(shape.vertices, shape.faces, normals=shape.normals, colors=colors)


def turned(shape: StoredShape) -> StoredShape:
    """Return the shape at an angle to all axes."""
    spin = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    spin *= np.linalg.det(spin)  # a reflection would turn the shape inside out
    return scenes.stored(shape.vertices @ spin.T, shape.faces, normals=shape.normals @ spin.T)


def turned_face(shape: StoredShape) -> StoredShape:
    """Return the shape with its first face wound the other way."""
    return scenes.stored(shape.vertices, [shape.faces[0, ::-1], *shape.faces[1:]])


LIGHT = np.array([[0.6, 0.64, 0.48]], np.float32)
SHINY = {"specular": 0.4, "shininess": 12.0, "ambient": 0.3, "diffuse": 0.6, "background": (0.2, 0.4, 0.1)}
FLAT_2X2 = {"shading": "flat", "supersample": 2}
STAGED: dict[str, Staged] = {
    **{f"stiff: {name}": Staged((shape,), STIFF_VIEWS, 25) for name, shape in scenes.stiff().items()},
    "chair": Staged((scenes.chair(),)),
    "turned chair, flat": Staged((turned(scenes.chair()),), changes={"shading": "flat"}),
    "ball": Staged((sphere(2),)),
    "ball, flat": Staged((sphere(2),), changes={"shading": "flat"}),
    "cylinder, shiny": Staged((cylinder(),), changes={**SHINY, "light_direction": LIGHT}),
    "cylinder, 2x2 samples": Staged((turned(cylinder()),), changes={"supersample": 2}),
    "box from within": Staged((scenes.box(),), INSIDE),
    "ball from within, shiny": Staged((sphere(2),), INSIDE, changes=SHINY),
    "ball in a ball": Staged((scenes.joined(sphere(2, 0.5), sphere(2, 0.9)),), (*AROUND, *INSIDE)),
    "ball and sheet": Staged((scenes.joined(scenes.soup(20, 3), sphere(2, 0.6)),)),
    "bumpy, shiny, flat, 2x2 samples": Staged((scenes.bumpy(10),), changes={**SHINY, **FLAT_2X2}),
    "each camera several times": Staged((scenes.chair(),), TWICE),
    "each camera several times, some without a gradient": Staged((turned(scenes.box()),), TWICE, blank=(0, 3)),
    "two shapes, one without a gradient": Staged((scenes.chair(), sphere(2)), blank=(4, 5, 6, 7)),
    "no gradient at all": Staged((scenes.chair(),), blank=(0, 1, 2, 3)),
    "colours at vertices": Staged((colored(scenes.soup(30, 1)),)),
    "colours at vertices of a body, flat, 2x2 samples": Staged(
        (colored(turned(scenes.box())),), changes=FLAT_2X2
    ),
    "three packed shapes": Staged((scenes.bumpy(6), scenes.soup(40, 8), cylinder())),
    "cards": Staged((cards(7000, 1),), (AROUND[0], (10.0, 5.0, 1.2)), 40),
    "cards, shiny, 2x2 samples": Staged((cards(6000, 2),), (AROUND[0],), 32, {**SHINY, "supersample": 2}),
    "ball of 20,480 faces": Staged((turned(sphere(5)),), AROUND[:2], 40),
    "one pixel": Staged((scenes.chair(),), size=1),
    "beside the picture": Staged((scenes.box((0.2, 0.2, 0.2), (5.0, 0.0, 0.0)),)),
}  # fmt: skip


@dataclass(frozen=True)
class Drawn:
    """What must not differ, and what was counted meanwhile.

    Attributes:
        images: (N, 3, H, W) of all views of all shapes.
        gradients: (N, 3), by azimuth, elevation and distance.
        ids: (N, S, S), the face that each sample sees.
        left_out: By skip.
    """

    images: np.ndarray
    gradients: np.ndarray
    ids: np.ndarray
    left_out: dict[str, int]


def draw(staged: Staged, skips: int) -> Drawn:
    """Draw forward and backward, and look at the samples; only the drawing is counted."""
    batch, count = scenes.batch_of(*staged.shapes), len(staged.shapes)
    angles, size = cameras(*staged.views, count=count), staged.size
    look = scenes.look(size, count, **staged.changes)
    leaves = [f.clone().requires_grad_() for f in (angles.azimuth_deg, angles.elevation_deg, angles.distance)]
    weights = np.random.default_rng(5).normal(size=(count * len(staged.views), 3, size, size))
    weights[list(staged.blank)] = 0
    tally().clear()
    rgb = render(batch, Cameras(*leaves, fov_deg=scenes.FOV), look, skips=skips).rgb
    rgb.backward(torch.from_numpy(weights).float().reshape(rgb.shape))
    left_out = dict(tally().left_out)
    gradients = torch.stack([leaf.grad for leaf in leaves], -1).numpy().reshape(-1, 3)
    return Drawn(
        rgb.detach().numpy().reshape(-1, 3, size, size), gradients, seen_ids(batch, angles, look, skips), left_out
    )


def seen_ids(batch: ShapeBatch, views: Cameras, look: Look, skips: int) -> np.ndarray:
    """Return the face that each sample of each view sees, (N, S, S)."""
    seen = MeshScene(batch, look, scenes.FOV, skips).see(matrices(views))
    return seen.ids[seen.view_of]


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    """Compare bytes, so that NaN is NaN; adding 0 makes -0, what a sum of nothing may be, 0."""
    return (a + a.dtype.type(0)).tobytes() == (b + b.dtype.type(0)).tobytes()


def assert_same(a: Drawn, b: Drawn) -> None:
    """Compare all of it."""
    for name in ("ids", "images", "gradients"):
        assert same_bits(getattr(a, name), getattr(b, name)), name


@pytest.fixture(scope="module")
def drawn() -> Callable[[str, int], Drawn]:
    """Each scene, drawn once with the skips that a test asks for."""
    return cache(lambda name, skips: draw(STAGED[name], skips))


def test_the_scenes_are_thirty_and_more_and_have_the_stiff_set():
    assert len(STAGED) >= 30 and sum(name.startswith("stiff") for name in STAGED) == len(scenes.stiff())


@pytest.mark.parametrize("skip", [skip for skip in KERNEL_SKIPS if skip != "backface"])
@pytest.mark.parametrize("name", STAGED)
def test_what_is_left_out_changes_no_bit(name, skip, drawn):
    assert_same(drawn(name, EVERYTHING), draw(STAGED[name], without([skip])))


@pytest.mark.parametrize("name", STAGED)
def test_all_that_is_left_out_at_once_changes_no_bit(name, drawn):
    assert_same(drawn(name, without(["backface"])), draw(STAGED[name], without(KERNEL_SKIPS)))


@pytest.mark.parametrize("name", STAGED)
def test_backface_changes_no_bit_but_for_a_sample_at_an_outline(name, drawn):
    """At an outline a corner's rounding to 1/256 sample decides whether its back or its front is seen.

    What is covered stays covered; views in which no such sample lies are equal bit for bit, image and gradient.
    """
    on, off = drawn(name, EVERYTHING), drawn(name, without(["backface"]))
    assert same_bits(on.ids < 0, off.ids < 0)
    differ = (on.ids != off.ids).sum(axis=(1, 2))
    assert differ.sum() <= (off.ids >= 0).sum() / 500
    for n in np.flatnonzero(differ == 0):
        assert same_bits(on.images[n], off.images[n]) and same_bits(on.gradients[n], off.gradients[n]), n
    size, fine = on.images.shape[2], on.ids.shape[1] // on.images.shape[2]
    pixels = (on.ids != off.ids).reshape(-1, size, fine, size, fine).any(axis=(2, 4))
    for n in np.flatnonzero(differ):
        elsewhere = ~binary_dilation(pixels[n], np.ones((3, 3)))
        assert same_bits(on.images[n][:, elsewhere], off.images[n][:, elsewhere]), n


BODIES = {
    "box": scenes.box(),
    "turned box": turned(scenes.box()),
    "plate": turned(scenes.box((1, 0.01, 1))),
    "cylinder": turned(cylinder()),
    "ball": turned(sphere(2)),
}


@pytest.mark.parametrize("shape", BODIES.values(), ids=BODIES)
def test_what_backface_changes_lies_beside_the_background(shape):
    """At most one sample in 1,000 of 120 views, each with background among its neighbours."""
    random = np.random.default_rng(0)
    columns = random.uniform(-180, 180, 120), random.uniform(-90, 90, 120), random.uniform(1.8, 3, 120)
    batch, views = scenes.batch_of(shape), cameras(*zip(*columns, strict=True))
    on, off = (seen_ids(batch, views, scenes.look(48), bits) for bits in (EVERYTHING, without(["backface"])))
    differ = on != off
    beside = binary_dilation(on < 0, np.ones((1, 3, 3)))
    assert beside[differ].all() and differ.sum() <= (on >= 0).sum() / 1000


def test_the_least_scene_in_which_backface_changes_a_sample():
    """With it the sample sees the body's front, as it should; without it, its back."""
    batch, views = scenes.batch_of(scenes.box()), cameras((91.588508669, -69.653077833, 2.647009781))
    on, off = (seen_ids(batch, views, scenes.look(8), bits) for bits in (EVERYTHING, without(["backface"])))
    assert np.argwhere(on != off).tolist() == [[0, 2, 3]]
    corners = scenes.box().vertices[scenes.box().faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rt = matrices(views)[0, 0]
    to_eye = ((-rt[:, :3].T @ rt[:, 3]) - corners[:, 0]) * outward
    assert to_eye[on[0, 2, 3]].sum() > 0 > to_eye[off[0, 2, 3]].sum()


OPENED = {
    "box, corner first": (scenes.box(np.full(3, 2 / 3**0.5)), (45.0, 35.2644, 1.005)),
    "ball": (sphere(2), (90.0, 0.0, 1.005)),
}


@pytest.mark.parametrize(("shape", "view"), OPENED.values(), ids=OPENED)
def test_the_inside_of_a_body_that_the_near_plane_cuts_open_is_seen(shape, view):
    batch, views = scenes.batch_of(shape), cameras(view)
    on, off = (seen_ids(batch, views, scenes.look(24), bits) for bits in (EVERYTHING, without(["backface"])))
    np.testing.assert_array_equal(on, off)


SOMEWHERE = {
    "frustum": "box from within",
    "backface": "ball",
    "no-sample": "ball of 20,480 faces",
    "occluded": "cards",
    "background": "chair",
    "near-clip": "chair",
    "same-view": "each camera several times",
    "no-gradient": "two shapes, one without a gradient",
}
NOWHERE = {  # skip: scenes in which it has nothing to leave out
    "frustum": ("chair", "cards"),
    "backface": ("cards", "colours at vertices", "box from within", "stiff: one face", "stiff: coplanar"),
    "occluded": ("chair", "ball", "box from within"),  # too few faces for tiles
    "background": ("box from within",),
    "same-view": ("chair", "three packed shapes"),
    "no-gradient": ("chair", "each camera several times"),
}


@pytest.mark.parametrize(("skip", "name"), SOMEWHERE.items())
def test_each_skip_leaves_something_out_and_its_counter_says_so(skip, name, drawn):
    assert drawn(name, EVERYTHING).left_out[skip] > 0


@pytest.mark.parametrize(("skip", "name"), [(skip, name) for skip, names in NOWHERE.items() for name in names])
def test_a_skip_that_has_nothing_to_leave_out_counts_nothing(skip, name, drawn):
    assert drawn(name, EVERYTHING).left_out[skip] == 0


@pytest.mark.parametrize("skip", SOMEWHERE)
def test_a_skip_that_is_off_counts_nothing(skip):
    assert draw(STAGED[SOMEWHERE[skip]], without([skip])).left_out.get(skip, 0) == 0


def face_counts(name: str, skips: int) -> np.ndarray:
    """Return what is counted in each view, (N, COUNTERS)."""
    staged = STAGED[name]
    batch, views = scenes.batch_of(*staged.shapes), cameras(*staged.views, count=len(staged.shapes))
    look = scenes.look(staged.size, len(staged.shapes), **staged.changes)
    return MeshScene(batch, look, scenes.FOV, skips).see(matrices(views)).counts


@pytest.mark.parametrize("off", [(), ("frustum",), ("no-sample",), ("near-clip",), KERNEL_SKIPS], ids=str)
@pytest.mark.parametrize("name", STAGED)
def test_each_face_is_counted_once(name, off):
    """Drawn, or left out for one reason."""
    counts = face_counts(name, without(off))
    reasons = [DRAWN, OUTSIDE, BEHIND_SOLID, COVERS_NOTHING, HIDDEN]
    np.testing.assert_array_equal(counts[:, reasons].sum(axis=1), counts[:, SEEN])
    if off == KERNEL_SKIPS:
        np.testing.assert_array_equal(counts[:, DRAWN], counts[:, SEEN])


@pytest.mark.parametrize("name", STAGED)
def test_faces_that_are_all_clipped_are_left_out_for_the_same_reasons(name):
    expected, found = face_counts(name, EVERYTHING), face_counts(name, without(["near-clip"]))
    np.testing.assert_array_equal(found[:, CLIPPED], expected[:, SEEN])
    others = [k for k in range(COUNTERS) if k != CLIPPED]
    np.testing.assert_array_equal(found[:, others], expected[:, others])


def solid_faces(shape: StoredShape) -> np.ndarray:
    """Return which faces are proved to be of a closed body."""
    return find_topology(shape.vertices, shape.faces).solid


def split(shape: StoredShape) -> StoredShape:
    """Return the shape with vertices of its own for each face."""
    return scenes.stored(shape.vertices[shape.faces].reshape(-1, 3), np.arange(3 * len(shape.faces)))


PROVED = {
    "cube": scenes.box(),
    "cube without shared vertices": split(scenes.box()),
    "cube beside the origin": scenes.box(center=(0.4, -0.2, 0.1)),
    "cylinder": cylinder(),
    "icosahedron": scenes.icosahedron(),
    "ball": sphere(2),
    "chair of boxes": scenes.joined(scenes.box((0.9, 0.1, 0.9)), scenes.box((0.2, 0.8, 0.3), (0.4, 0.3, 0.0))),
    "ball in a ball": scenes.joined(sphere(2, 0.5), sphere(2)),
}
NOT_PROVED = {
    "open box": scenes.stored(scenes.box().vertices, scenes.box().faces[2:]),
    "cube inside out": scenes.flipped(scenes.box()),
    "cube with one face turned": turned_face(scenes.box()),
    "cube with every face twice": scenes.joined(scenes.box(), scenes.box()),
    "Moebius band": mobius(),
    "figure that runs through itself": pentagram(),
    "torus": made(creation.torus(0.6, 0.25, 16, 8)),
    "cards": cards(20, 0),
    "flat body": scenes.stored([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [2, 1, 0]]),
    "NaN corner": scenes.stored(
        np.where(np.arange(24).reshape(8, 3) == 4, np.nan, scenes.box().vertices), scenes.box().faces
    ),
}


@pytest.mark.parametrize("shape", PROVED.values(), ids=PROVED)
def test_closed_star_shaped_bodies_are_proved(shape):
    assert solid_faces(shape).all()


@pytest.mark.parametrize("shape", NOT_PROVED.values(), ids=NOT_PROVED)
def test_what_is_open_or_inside_out_or_may_cut_itself_is_not_proved(shape):
    assert not solid_faces(shape).any()


def test_only_the_outer_of_two_balls_is_proved_where_the_inner_is_inside_out():
    outer = sphere(2)
    hollow = scenes.joined(outer, scenes.flipped(sphere(2, 0.5)))
    expected = np.arange(len(hollow.faces)) < len(outer.faces)
    np.testing.assert_array_equal(solid_faces(hollow).astype(bool), expected)
