"""Where the picture jumps between two samples, and how pixels are made from samples and jumps."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
from reference import scenes
from reference.crossings import jumps
from reference.drawing import cameras, hard_image, image, matrices, samples
from reference.rasteriser import rays, to_camera

SHAPES = {
    "bumpy": (scenes.bumpy(6), (13.0, 70.0, 2.5)),
    "icosahedron": (scenes.icosahedron(), (13.0, 7.0, 2.5)),
    "chair": (scenes.chair(), (35.0, 25.0, 2.2)),
    "soup": (scenes.soup(25, 1), (10.0, 20.0, 2.2)),
    "through each other": (scenes.stiff()["through each other"], (30.0, 30.0, 2.2)),
}
SIZE = 32


def jumps_of(name):
    """Yield, for each pair of samples that see different faces, the true jumps and the records found."""
    shape, view = SHAPES[name]
    found = samples(shape, view, scenes.look(SIZE))
    camera, ray = to_camera(shape.vertices, matrices(cameras(view))[0, 0]), rays(scenes.focal(SIZE), SIZE)
    records = defaultdict(list)
    for record, place in zip(found.records, found.where, strict=True):
        records[place].append(record)
    for j in range(SIZE):
        for i in range(SIZE):
            for down in (0, 1):
                j2, i2 = j + down, i + 1 - down
                if max(j2, i2) < SIZE and found.ids[j, i] != found.ids[j2, i2]:
                    step = ray[j2, i2] - ray[j, i]
                    yield (
                        jumps(camera, shape.faces, ray[j, i], step),
                        records.pop((j, i, down), []),
                        ray[j, i],
                        step,
                    )
    assert not records, "a jump was found between samples that see the same face"


@pytest.mark.parametrize("name", SHAPES)
def test_silhouettes_lie_where_asking_every_face_finds_them(name):
    """T14 too. Pairs of samples with one jump between them, deeper than 2 percent."""
    compared = 0
    for true, found, ray, step in jumps_of(name):
        if len(true) == 1 and true[0].depth_step > 0.02:
            assert len(found) == 1, "a silhouette was missed"
            share, _, x, y, z = found[0][:5]
            assert share == pytest.approx(true[0].share, abs=1e-5)
            at = ray + share * step
            np.testing.assert_allclose([x / z, y / z], at[:2], atol=1e-5)
            compared += 1
    assert compared > 50


@pytest.mark.parametrize("name", ["bumpy", "icosahedron"])
def test_edges_inside_one_surface_are_no_jumps(name):
    smooth = [found for true, found, *_ in jumps_of(name) if not true]
    assert len(smooth) > 30 and not any(smooth)


def intersections(name):
    """Return how far the found jumps are from the lines where surfaces meet, in samples."""
    pairs = [(true[0], found) for true, found, *_ in jumps_of(name) if len(true) == 1]
    return np.array([abs(found[0][0] - true.share) for true, found in pairs if found and true.depth_step < 1e-6])


def test_surfaces_that_meet_have_a_jump_where_they_meet():
    """T14, away from the ends of the two surfaces."""
    off = intersections("through each other")
    assert len(off) > 15 and (off < 1e-5).mean() > 0.9


def test_surfaces_that_meet_near_an_end_of_one_have_a_jump_where_they_meet():
    """T14. One of the two ends behind the other within the same step: what is seen to end is not that end."""
    for name in ("chair", "soup"):
        off = intersections(name)
        assert len(off) > 5
        np.testing.assert_allclose(off, 0, atol=1e-5)


def blended(found, look):
    """Return the image that samples and records make: each jump is moved to where it is."""
    size, fine = look.image_size, look.supersample
    pixels = found.colors.astype(np.float64).reshape(3, size, fine, size, fine).mean(axis=(2, 4))
    for record, (j, i, down) in zip(found.records.astype(np.float64), found.where, strict=True):
        share, slope = record[0], abs(record[1])
        jump = record[5] * (found.colors[:, j, i] - found.colors[:, j + down, i + 1 - down]).astype(np.float64)
        if slope > 1 or (slope == 1 and down):
            continue
        if share > 0.5:
            j, i = j + down, i + 1 - down
        pixels[:, j // fine, i // fine] -= (0.5 - share) * jump / fine**2
    return np.clip(pixels, 0, 1)


@pytest.mark.parametrize("fine", [1, 2, 4])
@pytest.mark.parametrize("name", SHAPES)
def test_a_pixel_is_the_mean_of_its_samples_with_jumps_moved_to_their_place(name, fine):
    shape, view = SHAPES[name]
    look = scenes.look(24, supersample=fine, light_direction=np.array([[0.48, 0.6, 0.64]], np.float32))
    found = samples(shape, view, look)
    np.testing.assert_allclose(found.image, blended(found, look), atol=1e-5)
    np.testing.assert_array_equal(found.image, image(shape, cameras(view), look)[0])


def rms(difference):
    return np.sqrt((difference**2).mean())


@pytest.mark.parametrize(("name", "gain"), [("icosahedron", 2.0), ("bumpy", 1.3), ("chair", 1.1)])
def test_more_samples_and_antialiasing_both_bring_the_picture_nearer_to_the_truth(name, gain):
    """Truth: the mean of 16 by 16 samples a pixel. Faces thinner than a sample hold antialiasing back."""
    shape, view = SHAPES[name]
    truth = hard_image(shape, view, scenes.look(64, supersample=16))
    hard = {n: rms(hard_image(shape, view, scenes.look(64, supersample=n)) - truth) for n in (1, 4)}
    soft = {n: rms(image(shape, cameras(view), scenes.look(64, supersample=n))[0] - truth) for n in (1, 2, 4)}
    assert hard[4] < hard[1] / 3
    assert soft[1] < hard[1] / gain and soft[4] < hard[4] / gain
    assert soft[2] < soft[1] / 1.5 and soft[4] < soft[2] / 1.5


def test_the_area_of_a_square_is_right_to_a_hundredth_of_a_pixel_a_side():
    """Ambient light alone: the sum of the image is the area that is covered."""
    square = scenes.stored([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]], [[0, 1, 2], [0, 2, 3]])
    for distance in np.linspace(1.5, 2.5, 9):
        look = scenes.look(40, ambient=1.0, diffuse=0.0)
        side = scenes.focal(40) / np.float32(distance)
        total = image(square, cameras((0, 0, float(distance))), look)[0, 0].sum()
        assert total == pytest.approx(side**2, abs=1.0)  # the four corners are cut, at most a quarter of a pixel each
