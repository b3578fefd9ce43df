"""What a trained recogniser says does not depend on how it is asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from mvtn_cli.core.networks.recogniser import build_recogniser
from mvtn_cli.core.training.loop import train
from mvtn_cli.core.training.predict import load_model, predict
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.training.shapes import alike_batches, load_batch
from mvtn_cli.errors import DataError, UsageError


def test_the_best_weights_give_the_validation_numbers_of_the_best_epoch(settings, boxes, quiet):
    run = train(settings(epochs=3), boxes, quiet)
    model = load_model(run, "best", "cpu")
    answers = predict(model, boxes, boxes.split("val"), run.config, batch_size=4)
    assert answers.accuracy == run.best["val_accuracy"]
    assert answers.loss == pytest.approx(run.best["val_loss"], abs=1e-6)
    assert answers.names == tuple(boxes.records[i].name for i in boxes.split("val"))
    assert answers.labels.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("views", ["learned-spherical", "jittered"])
def test_answers_do_not_depend_on_batch_size_order_or_repetition(views, settings, boxes):
    config = settings(views=views)
    model = build_recogniser(config, 4).train()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    indices = list(range(8))
    together = predict(model, boxes, indices, config, batch_size=8, keep_images=3)
    singly = predict(model, boxes, indices[::-1], config, batch_size=1)
    assert np.allclose(together.logits, singly.logits[::-1], atol=1e-5)
    assert np.allclose(together.azimuth_deg, singly.azimuth_deg[::-1], atol=1e-4)
    assert np.array_equal(together.logits, predict(model, boxes, indices, config, batch_size=8).logits)
    assert together.images.shape == (3, 2, 3, 16, 16) and together.images.max() > 50 and singly.images is None
    assert model.training and all(torch.equal(value, before[name]) for name, value in model.state_dict().items())


def test_pictures_kept_are_those_of_the_first_shapes_over_several_batches(settings, boxes):
    config = settings(views="fixed")
    model = build_recogniser(config, 4)
    all_at_once = predict(model, boxes, range(8), config, batch_size=8, keep_images=8).images
    assert np.array_equal(predict(model, boxes, range(8), config, batch_size=2, keep_images=5).images, all_at_once[:5])


def test_random_views_are_the_same_ones_each_time(settings, boxes):
    config = settings(views="random", num_views=5)
    model = build_recogniser(config, 4)
    first, second = (predict(model, boxes, range(4), config, batch_size=2) for _ in range(2))
    assert np.array_equal(first.azimuth_deg, second.azimuth_deg)
    assert len(np.unique(first.azimuth_deg)) == 20


def test_meshes_and_point_clouds_are_drawn_each_in_its_way(settings, boxes):
    config = settings(views="fixed")
    load, empty = boxes.load, np.zeros((0, 3), np.float32)

    def load_some_as_points(index: int):
        shape = load(index)
        cloud = replace(shape, vertices=empty, faces=empty.astype(np.int32), normals=empty)
        return cloud if index in (2, 3, 5) else shape

    boxes.load = load_some_as_points
    assert list(alike_batches(boxes, range(7), 2, "auto")) == [[0, 1], [2, 3], [4], [5], [6]]
    assert [load_batch(boxes, b, "auto")[1] for b in ([0, 1], [2, 3])] == ["mesh", "points"]
    assert load_batch(boxes, [1, 2], "points")[1] == "points"
    for render in ("auto", "mesh"):
        with pytest.raises(DataError, match="post/train2 has no mesh"):
            load_batch(boxes, [1, 2], render)
    answers = predict(build_recogniser(config, 4), boxes, range(7), config, batch_size=4, keep_images=7)
    assert np.isfinite(answers.logits).all() and (answers.images.reshape(7, -1).std(axis=1) > 1).all()


def test_weights_that_are_not_there_are_a_clear_error(settings, boxes, quiet, tmp_path):
    run = Run.create(tmp_path / "runs" / "new", settings(), boxes)
    with pytest.raises(DataError, match="has no best weights yet"):
        load_model(run)
    with pytest.raises(DataError, match="no trained run"):
        Run.latest(tmp_path / "runs")
    with pytest.raises(DataError, match="no shapes"):
        predict(build_recogniser(settings(), 4), boxes, [], settings(), batch_size=4)


@pytest.mark.parametrize("file", ["run.json", "config.toml", "last.safetensors"])
def test_half_a_file_of_a_run_is_named_with_what_to_do(file, settings, boxes, quiet):
    run = train(settings(epochs=1), boxes, quiet)
    content = (run.path / file).read_bytes()
    # half of a list of settings may be one, too: this one ends within a word
    middle = content.rindex(b'"') if file == "config.toml" else len(content) // 2
    (run.path / file).write_bytes(content[:middle])
    with pytest.raises(DataError, match=r"^can't read .*") as broken:
        load_model(run, "last")
    assert str(run.path / file) in broken.value.message and "\n" not in broken.value.message
    assert broken.value.hint


def test_a_device_that_is_not_there_is_a_usage_error(settings, boxes, quiet):
    run = train(settings(epochs=1), boxes, quiet)
    with pytest.raises(UsageError, match="cuda:99"):
        load_model(run, "best", "cuda:99")
