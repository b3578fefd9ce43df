"""Neighbours and spread-out choices of views: as by brute force, and in no case by how the views are numbered."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from mvtn_cli.core.networks.view_graph import canonical_order, farthest_views, nearest_views, pick
from mvtn_cli.core.views import layouts
from mvtn_cli.core.views.symmetry import view_directions

LAYOUTS = [("circular", 12), ("spherical", 20), ("dodecahedral", 20), ("random", 9), ("spherical", 4)]


def directions(layout: str, num_views: int, batch: int = 2) -> torch.Tensor:
    azimuth, elevation = layouts(layout, num_views)
    return torch.from_numpy(view_directions(azimuth, elevation)).float().expand(batch, -1, -1)


def permutation(count: int, seed: int) -> torch.Tensor:
    return torch.randperm(count, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize(("layout", "num_views"), LAYOUTS)
def test_order_goes_up_and_around_and_does_not_depend_on_the_numbering(layout, num_views):
    views = directions(layout, num_views)
    sorted_views = pick(views, canonical_order(views))
    assert (sorted_views[:, 1:, 1] - sorted_views[:, :-1, 1]).min() > -1e-4
    for seed in range(5):
        shuffled = views[:, permutation(num_views, seed)]
        assert torch.equal(pick(shuffled, canonical_order(shuffled)), sorted_views)


def test_order_has_no_seam_where_azimuths_wrap():
    angles = torch.tensor([-180.0, 180.0 - 1e-5, 0.0, -1e-5, 90.0]).deg2rad()
    ring = torch.stack([angles.sin(), torch.zeros(5), angles.cos()], dim=-1)[None]
    assert canonical_order(ring)[0].tolist() == [2, 3, 4, 0, 1]


@pytest.mark.parametrize(("layout", "num_views"), LAYOUTS)
def test_neighbours_are_the_nearest_with_the_view_itself_first(layout, num_views):
    views = directions(layout, num_views)
    centres = torch.arange(num_views).expand(2, -1)
    near = nearest_views(views, centres, 4)
    assert torch.equal(near[..., 0], centres)
    apart = torch.cdist(views.double(), views.double())
    expected = apart.sort(dim=2).values[..., :4]
    torch.testing.assert_close(apart.gather(2, near), expected, atol=0.02, rtol=0)
    assert all(len(set(row)) == 4 for row in near[0].tolist())


def test_equally_near_views_are_taken_in_their_order_whatever_the_rounding():
    views = directions("circular", 12)
    turned = views.double() @ torch.linalg.matrix_exp(torch.tensor([[0, 1e-7, 0], [-1e-7, 0, 0], [0, 0, 0]])).double()
    centres = torch.arange(12).expand(2, -1)
    near = nearest_views(views, centres, 4)
    assert torch.equal(near, nearest_views(turned.float(), centres, 4))
    # one and two steps to either side: of the two that are two steps away the one with the lower number
    assert near[0, 5].tolist() == [5, 4, 6, 3] and near[0, 0].tolist() == [0, 1, 11, 2]


@pytest.mark.parametrize(("layout", "num_views"), LAYOUTS)
@pytest.mark.parametrize("count", [1, 3, 4])
def test_each_chosen_view_is_the_farthest_from_those_before(layout, num_views, count):
    views, first = directions(layout, num_views), torch.tensor([0, 2])
    chosen = farthest_views(views, count, first)
    assert torch.equal(chosen[:, 0], first)
    apart = torch.cdist(views.double(), views.double()).numpy() ** 2
    for shape, row in enumerate(chosen.tolist()):
        for n in range(1, count):
            free = apart[shape][:, row[:n]].min(axis=1)
            assert free[row[n]] > free.max() - 3e-4


def test_no_view_is_chosen_twice_also_where_all_coincide():
    same = torch.tensor([0.0, 0.0, 1.0]).expand(1, 6, 3)
    assert sorted(farthest_views(same, 6, torch.tensor([3]))[0].tolist()) == list(range(6))
    near = nearest_views(same, torch.arange(6)[None], 4)
    assert near[0, :, 0].tolist() == list(range(6)) and all(len(set(row)) == 4 for row in near[0].tolist())


def test_pick_takes_whole_views_of_their_own_shape():
    values, index = torch.randn(3, 5, 2), torch.from_numpy(np.random.default_rng(0).integers(0, 5, (3, 4, 2)))
    picked = pick(values, index)
    assert picked.shape == (3, 4, 2, 2)
    assert all(torch.equal(picked[b, s, k], values[b, index[b, s, k]]) for b, s, k in np.ndindex(3, 4, 2))
