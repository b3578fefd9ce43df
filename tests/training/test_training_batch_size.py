"""How many shapes a step fit into memory."""

from __future__ import annotations

import copy
import io
from pathlib import Path
from typing import Any

import pytest
import torch

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.networks import build_recogniser
from mvtn_cli.core.training import batch_size
from mvtn_cli.core.training.batch_size import bytes_of_shape, common_batch_size, fitting_batch_size
from mvtn_cli.core.training.device import memory_limits
from mvtn_cli.errors import MvtnError

TINY = {"image_size": 32, "num_views": 4, "encoder_points": 64, "device": "cpu", "supersample": 1}
GIB = 1 << 30


@pytest.fixture
def gibibytes(monkeypatch: pytest.MonkeyPatch):
    """Sets how much memory there is."""
    return lambda count: monkeypatch.setattr(batch_size, "memory_of", lambda device: int(count * GIB))


@pytest.mark.parametrize("network", ["mvcnn", "rotationnet", "viewgcn", "pointnet", "dgcnn"])
def test_what_is_kept_is_counted_without_computing_and_without_touching_the_model(
    network: str, monkeypatch: pytest.MonkeyPatch
):
    """The same as what a real forward pass keeps."""
    layout = {"layout": "circular", "views": "learned-circular"} if network == "rotationnet" else {}
    config = TrainConfig(network=network, **TINY, **layout)
    model = build_recogniser(config, 5)
    before = copy.deepcopy(model.state_dict())
    counted = bytes_of_shape(model, config)
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())
    with monkeypatch.context() as real:
        real.setattr(batch_size, "FakeTensorMode", lambda **_: torch.autograd.set_detect_anomaly(False))
        assert bytes_of_shape(model, config) == counted > 0


def test_more_views_larger_pictures_and_finer_samples_need_more_and_bfloat16_less():
    def need(*, mixed: bool = False, **changes: object) -> float:
        config = TrainConfig(**{**TINY, **changes})
        return bytes_of_shape(build_recogniser(config, 5), config, mixed=mixed)

    plain = need()
    assert 1.9 < need(num_views=8) / plain < 2.1
    assert need(image_size=64) > 3 * plain and need(supersample=2) > plain
    assert need(mixed=True) < plain


def test_the_batch_is_a_power_of_two_that_fits_and_grows_with_memory(gibibytes):
    """ResNet-18 with two views of 224 pixels keeps some 70 MiB a shape."""
    config = TrainConfig(backbone="resnet18", image_size=224, num_views=2, device="cpu")
    sizes = []
    for count in (5, 6, 8, 12, 1000):
        gibibytes(count)
        sizes.append(fitting_batch_size(config, 40, 9843))
    assert sizes == sorted(sizes) and sizes[0] < sizes[-1] == 128
    assert all(size & (size - 1) == 0 for size in sizes)


def test_the_defaults_fit_into_a_small_container(gibibytes):
    gibibytes(2)
    assert fitting_batch_size(TrainConfig(device="cpu"), 12, 432) == 32


@pytest.mark.parametrize("views", ["fixed", "random", "transferred"])
def test_views_that_do_not_learn_need_no_viewpoint_network_for_it(views: str):
    config = TrainConfig(**TINY, views=views, views_from="not read" if views == "transferred" else None)
    model = build_recogniser(config, 5, read_weights=False)
    learned = TrainConfig(**TINY)
    assert 0 < bytes_of_shape(model, config) < bytes_of_shape(build_recogniser(learned, 5), learned)


@pytest.mark.parametrize(("shapes", "most"), [(10, 32), (432, 32), (4096, 64), (9843, 128), (800_000, 256)])
def test_memory_without_end_gives_no_batch_that_leaves_too_few_steps(gibibytes, shapes: int, most: int):
    gibibytes(10_000)
    assert fitting_batch_size(TrainConfig(**TINY), 5, shapes) == most


def test_processes_of_one_machine_share_its_memory_and_those_of_several_add_theirs(gibibytes):
    config = TrainConfig(backbone="resnet18", image_size=224, num_views=8, device="cpu")
    gibibytes(6)
    alone = fitting_batch_size(config, 40, 9843)
    gibibytes(12)
    assert fitting_batch_size(config, 40, 9843, here=2, size=4) == 4 * alone


def test_trainings_that_are_compared_take_what_fits_for_each(gibibytes, boxes: Any):
    gibibytes(8)
    err = io.StringIO()
    large = TrainConfig(backbone="resnet18", image_size=224, num_views=4, device="cpu")
    small = large.model_copy(update={"num_views": 1})
    sizes = [common_batch_size([one], boxes, Console(quiet=True)) for one in (large, small)]
    assert sizes[0] < sizes[1]
    assert common_batch_size([small, large], boxes, Console(err=err)) == sizes[0]
    assert err.getvalue() == f"batch size {sizes[0]} (auto)\n"


def test_a_memory_too_small_for_two_shapes_is_said(gibibytes):
    gibibytes(4.1)
    with pytest.raises(MvtnError, match=r"memory of cpu \(4.1 GiB\) does not hold a step of two shapes") as told:
        fitting_batch_size(TrainConfig(backbone="resnet50", image_size=512, num_views=20, device="cpu"), 40, 100)
    assert "--image-size" in told.value.hint


def test_what_containers_and_batch_systems_allow_is_found(tmp_path: Path):
    own = tmp_path / "own"
    own.write_text("0::/job/step\n")
    (tmp_path / "job" / "step").mkdir(parents=True)
    assert memory_limits(tmp_path, own) == []
    (tmp_path / "memory.max").write_text("max\n")
    (tmp_path / "job" / "memory.max").write_text(f"{6 * GIB}\n")
    (tmp_path / "job" / "step" / "memory.max").write_text(f"{8 * GIB}\n")
    assert sorted(memory_limits(tmp_path, own)) == [6 * GIB, 8 * GIB]


def test_limits_of_the_older_kind_are_found(tmp_path: Path):
    own = tmp_path / "own"
    own.write_text("5:memory:/job\n4:cpu:/\n")
    (tmp_path / "memory" / "job").mkdir(parents=True)
    (tmp_path / "memory" / "job" / "memory.limit_in_bytes").write_text(f"{3 * GIB}\n")
    assert memory_limits(tmp_path, own) == [3 * GIB]
    assert memory_limits(tmp_path / "none", tmp_path / "missing") == []
