"""Learning rates and exploration over a training."""

from __future__ import annotations

import pytest
import torch
from torch.optim import SGD
from torch.optim.lr_scheduler import OneCycleLR

from mvtn_cli.core.training import schedules
from mvtn_cli.core.training.learner import CLASSIFIER, VIEWPOINTS


def test_one_cycle_is_the_one_of_torch():
    steps = 4000  # many, as torch ends its warm-up one step early
    optimiser = SGD([torch.nn.Parameter(torch.zeros(1))], lr=1.0)
    reference = OneCycleLR(optimiser, max_lr=1.0, total_steps=steps + 1, pct_start=0.15, cycle_momentum=False)
    for step in range(steps):
        assert abs(reference.get_last_lr()[0] - schedules.one_cycle(step / steps)) < 3e-3
        optimiser.step()
        reference.step()


@pytest.mark.parametrize(("progress", "share"), [(0, 1 / 25), (0.15, 1), (0.575, 0.5), (1, 1 / 250_000), (0.075, 0.52)])
def test_one_cycle_passes_through_the_values_of_its_definition(progress: float, share: float):
    assert schedules.one_cycle(progress) == pytest.approx(share, abs=1e-5)


@pytest.mark.parametrize(
    ("progress", "share"), [(0, 0), (0.025, 0.5), (0.05, 1), (0.3, 1), (0.6, 1), (0.8, 0.5), (1, 0)]
)
def test_the_viewpoint_network_warms_up_stays_and_falls(progress: float, share: float):
    assert schedules.warm_constant_linear(progress) == pytest.approx(share)


@pytest.mark.parametrize(
    ("selection", "views", "asked", "degrees"),
    [
        ("learned-direct", 12, None, 45),
        ("learned-spherical", 1, None, 45),
        ("learned-circular", 6, None, 15),
        ("learned-spherical", 6, 0.0, 0),
        ("learned-direct", 1, 90.0, 90),
        ("fixed", 6, None, 0),
        ("jittered", 6, 45.0, 0),
    ],
)
def test_exploration_starts_where_the_form_of_the_views_says(
    selection: str, views: int, asked: float | None, degrees: float
):
    assert schedules.full_explore_deg(selection, views, asked) == degrees


def test_exploration_falls_in_a_line_to_zero_at_80_percent():
    assert [schedules.explore_deg(40, p) for p in (0, 0.2, 0.4, 0.8, 0.9)] == pytest.approx([40, 30, 20, 0, 0])


def test_each_group_gets_its_own_peak_times_the_share_of_its_network(settings):
    weights = [torch.nn.Parameter(torch.zeros(1)) for _ in range(3)]
    optimisers = {
        CLASSIFIER: SGD([{"params": weights[:1], "peak": 2.0}, {"params": weights[1:2], "peak": 0.2}], lr=9),
        VIEWPOINTS: SGD([{"params": weights[2:], "peak": 3.0}], lr=9),
    }
    explore = schedules.set_all(settings(views="learned-direct"), optimisers, progress=0.8)
    share = schedules.one_cycle(0.8)
    assert [g["lr"] for o in optimisers.values() for g in o.param_groups] == pytest.approx(
        [2 * share, 0.2 * share, 1.5]
    )
    assert explore == pytest.approx(0)
