"""Views that were kept are painted like views that are seen: the same bits, under any light and colour."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from reference import scenes
from reference.drawing import cameras

from mvtn_cli.console import Console
from mvtn_cli.core.render import Look, pack, render
from mvtn_cli.core.render.kept_views import KeptViews
from mvtn_cli.core.render.skips import EVERYTHING, without
from mvtn_cli.core.render.tally import tally
from mvtn_cli.core.render.view_keeper import KeptBatch, ViewKeeper, kept_batch, views_address
from mvtn_cli.core.store import Store, StoredShape

VIEWS = ((0.0, 0.0, 2.2), (33.0, 21.0, 1.7), (200.0, -75.0, 1.2), (33.0, 21.0, 0.3), (0.0, 0.0, 2.2))
SHAPES = {
    **{f"stiff: {name}": shape for name, shape in scenes.stiff().items()},
    "chair": scenes.chair(),
    "bumpy": scenes.bumpy(8),
    "colours": scenes.soup(30, 1, colored=True),
    "in a corner": scenes.box((0.1, 0.1, 0.1), (0.6, 0.6, 0.0)),
}
LOOKS = {
    "plain": {},
    "flat": {"shading": "flat"},
    "2x2 samples": {"supersample": 2},
    "shiny from aside": {
        "specular": 0.4,
        "shininess": 12.0,
        "ambient": 0.3,
        "diffuse": 0.6,
        "background": (0.2, 0.4, 0.1),
        "light_direction": np.array([[0.6, 0.64, 0.48]], np.float32),
        "colors": np.array([[0.9, 0.5, 0.2]], np.float32),
    },
}


def keeper(store: Store | None = None, **changed) -> ViewKeeper:
    return ViewKeeper(store, Console(quiet=True), **changed)


def kept(by: ViewKeeper, *shapes: StoredShape) -> KeptBatch:
    return kept_batch(shapes, [f"shape {n}" for n in range(len(shapes))], by)


def bits(batch, look: Look, views=VIEWS, skips: int = EVERYTHING) -> np.ndarray:
    chosen = cameras(*views, count=len(batch))
    return render(batch, chosen, look, gradient="none", skips=skips).rgb.numpy().view(np.uint32)


@pytest.mark.parametrize("changes", LOOKS.values(), ids=LOOKS)
@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_kept_views_give_the_same_bits_when_first_seen_and_ever_after(shape, changes):
    look, by = scenes.look(25, 1, **changes), keeper()
    expected = bits(pack([shape]), look)
    first = bits(kept(by, shape), look)
    before = tally().rasterised
    again = bits(kept(by, shape), look)
    assert tally().rasterised == before
    np.testing.assert_array_equal(first, expected)
    np.testing.assert_array_equal(again, expected)


def test_other_lights_colours_and_materials_need_no_other_views():
    by, shape = keeper(), scenes.bumpy(8)
    bits(kept(by, shape), scenes.look(24))
    before, seen = tally().rasterised, []
    for changes in ({}, LOOKS["shiny from aside"], {"falloff": 1.0}, {"background": (1.0, 1.0, 1.0)}):
        look = scenes.look(24, 1, **changes)
        seen.append(bits(kept(by, shape), look))
        assert tally().rasterised == before
        np.testing.assert_array_equal(seen[-1], bits(pack([shape]), look))
        before = tally().rasterised
    assert all(not np.array_equal(seen[0], other) for other in seen[1:])


def test_batches_of_coloured_and_plain_shapes_in_any_company():
    """The plain ones are white beside coloured ones; what is kept of them is the same."""
    plain, coloured, by = scenes.chair(), scenes.soup(30, 1, colored=True), keeper()
    look = scenes.look(24, 3)
    mixed = (plain, coloured, scenes.bumpy(8))
    expected = bits(pack(mixed), look)
    np.testing.assert_array_equal(bits(kept(by, *mixed), look), expected)
    before = tally().rasterised
    np.testing.assert_array_equal(bits(kept(by, *mixed), look), expected)
    np.testing.assert_array_equal(bits(kept(by, plain), scenes.look(24)), bits(pack([plain]), scenes.look(24)))
    assert tally().rasterised == before + len(VIEWS) - 1  # of the picture without a keeper; one view occurs twice


@pytest.mark.parametrize(
    "changes", [{"image_size": 20}, {"shading": "flat"}, {"supersample": 2}], ids=["size", "shading", "samples"]
)
def test_what_decides_about_visibility_is_part_of_the_address(changes):
    look, rts = scenes.look(24), np.zeros((2, 3, 4))
    address = views_address("a", rts, look, 60.0, EVERYTHING)
    others = [
        views_address("a", rts, replace(look, **changes), 60.0, EVERYTHING),
        views_address("b", rts, look, 60.0, EVERYTHING),
        views_address("a", rts + 1e-15, look, 60.0, EVERYTHING),
        views_address("a", rts[:1], look, 60.0, EVERYTHING),
        views_address("a", rts, look, 60.5, EVERYTHING),
        views_address("a", rts, look, 60.0, without(["background"])),
    ]
    assert len({address, *others}) == 7
    assert address == views_address("a", rts, replace(look, ambient=0.7), 60.0, without(["shading-terms"]))


@pytest.mark.parametrize("name", ["background", "same-view", "backface", "shading-terms"])
def test_skips_that_are_off_stay_off(name):
    shape, look, by = scenes.bumpy(8), scenes.look(24, 1, **LOOKS["shiny from aside"]), keeper()
    expected = bits(pack([shape]), look, skips=without([name]))
    for _ in range(2):
        np.testing.assert_array_equal(bits(kept(by, shape), look, skips=without([name])), expected)


def test_without_fixed_views_everything_is_drawn_anew_and_nothing_is_kept():
    by, shape, look = keeper(), scenes.chair(), scenes.look(24)
    expected = bits(kept(by, shape), look)
    known, before = dict(by.views), tally().rasterised
    off = without(["fixed-views"])
    np.testing.assert_array_equal(bits(kept(by, shape), look, skips=off), expected)
    drawn = tally().rasterised - before
    bits(kept(by, scenes.bumpy(8)), scenes.look(25), skips=off)
    assert drawn == len(set(VIEWS)) and by.views == known


def test_views_that_are_painted_are_counted():
    by, shape, look = keeper(), scenes.chair(), scenes.look(24)
    counted = []
    for _ in range(2):
        tally().clear()
        bits(kept(by, shape), look)
        counted.append((tally().left_out["fixed-views"], tally().of["fixed-views"]))
    assert counted == [(0, len(VIEWS)), (len(VIEWS), len(VIEWS))]


def test_cameras_that_want_a_gradient_get_it_and_nothing_is_kept():
    shape, look, by = scenes.bumpy(8), scenes.look(24), keeper()
    found = []
    for batch in (kept(by, shape), pack([shape])):
        views = cameras(*VIEWS[:2], grad=True)
        rgb = render(batch, views, look).rgb
        (rgb * torch.linspace(0, 1, rgb.numel()).reshape(rgb.shape)).sum().backward()
        found.append((rgb.detach(), views.azimuth_deg.grad))
    assert not by.views and (found[0][1] != 0).all()
    assert torch.equal(found[0][0], found[1][0]) and torch.equal(found[0][1], found[1][1])


def test_points_and_geometry_of_a_kept_batch_are_those_of_a_plain_one():
    shape, by = scenes.bumpy(8), keeper()
    views = cameras(*VIEWS[:2])
    for look, outputs in ((scenes.look(24, kind="points"), ()), (scenes.look(24), ("geometry",))):
        mine = render(kept(by, shape), views, look, outputs=outputs)
        theirs = render(pack([shape]), views, look, outputs=outputs)
        assert torch.equal(mine.rgb, theirs.rgb)
        if outputs:
            np.testing.assert_array_equal(mine.face_ids, theirs.face_ids)


def test_only_a_shape_that_is_new_is_seen():
    by, look = keeper(), scenes.look(24, 2)
    bits(kept(by, scenes.chair()), scenes.look(24), VIEWS[:3])
    before = tally().rasterised
    bits(kept(by, scenes.chair(), scenes.bumpy(8)), look, VIEWS[:3])
    assert tally().rasterised == before + 3


def test_memory_stays_within_its_budget_and_the_store_has_the_rest(tmp_path: Path):
    shapes, look = (scenes.chair(), scenes.bumpy(8), scenes.icosahedron()), scenes.look(24, 3)
    unlimited = keeper()
    expected = bits(kept(unlimited, *shapes), look)
    sizes = [views.nbytes for views in unlimited.views.values()]
    by = keeper(Store(tmp_path), budget=max(sizes))
    bits(kept(by, *shapes), look)
    assert 0 < by.used == sum(views.nbytes for views in by.views.values()) <= by.budget < sum(sizes)
    before = tally().rasterised
    np.testing.assert_array_equal(bits(kept(by, *shapes), look), expected)
    assert tally().rasterised == before


def test_without_a_store_and_with_too_little_memory_views_are_seen_again():
    by, shape, look = keeper(budget=100), scenes.chair(), scenes.look(24)
    expected = bits(kept(by, shape), look)
    before = tally().rasterised
    np.testing.assert_array_equal(bits(kept(by, shape), look), expected)
    assert not by.views and tally().rasterised > before


def test_the_stated_size_is_the_size():
    """Docs: 12 bytes a covered sample (24 with colours), a bit a sample of the box, 16 a jump, 144 a view."""
    for shape, each in ((scenes.bumpy(8), 12), (scenes.soup(30, 1, colored=True), 24)):
        by = keeper()
        bits(kept(by, shape), scenes.look(24))
        (views,) = by.views.values()
        stated = each * views.samples.sum() + len(views.covered) + 16 * views.jumps.sum() + 144 * len(views)
        assert views.nbytes == stated
        assert len(views.covered) <= sum((b - a + 9) * (d - c + 9) / 8 for a, b, c, d in views.boxes)
        assert isinstance(views, KeptViews) and views.samples.sum() > 0
