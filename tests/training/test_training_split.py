"""Which shapes are trained on, in which order, and which choose the best epoch."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mvtn_cli.core.training.randomness import epoch_batches, step_generator, step_seed
from mvtn_cli.core.training.split import (
    shown_indices,
    stratified_split,
    stratified_subset,
    training_indices,
)
from mvtn_cli.errors import DataError

labels_of_shapes = st.lists(st.integers(0, 4), min_size=1, max_size=80)


@given(labels_of_shapes, st.floats(0.01, 0.9), st.integers(0, 5))
def test_a_split_loses_nothing_and_takes_its_share_of_every_class(labels, fraction, seed):
    indices = list(range(100, 100 + len(labels)))
    kept, off = stratified_split(indices, labels, fraction, seed)
    assert sorted(kept + off) == indices and kept == sorted(kept) and off == sorted(off)
    whole, taken = Counter(labels), Counter(labels[i - 100] for i in off)
    for label, count in whole.items():
        assert taken[label] < count  # a class never loses its last shape
        assert taken[label] == 0 if count == 1 else taken[label] >= 1
        assert abs(taken[label] - fraction * count) <= 1 or taken[label] in (1, count - 1)
    assert stratified_split(indices, labels, fraction, seed) == (kept, off)


@given(labels_of_shapes, st.integers(1, 90), st.integers(0, 5))
def test_a_subset_is_as_even_over_the_classes_as_it_can_be(labels, limit, seed):
    indices = list(range(len(labels)))
    chosen = stratified_subset(indices, labels, limit, seed)
    assert len(chosen) == min(limit, len(labels)) and chosen == sorted(set(chosen))
    whole, taken = Counter(labels), Counter(labels[i] for i in chosen)
    most = max(taken.values())
    assert all(taken[label] >= min(count, most - 1) for label, count in whole.items())


def test_other_seeds_hold_out_other_shapes():
    labels = [0] * 50 + [1] * 50
    held_out = {tuple(stratified_split(range(100), labels, 0.1, seed)[1]) for seed in range(5)}
    assert len(held_out) == 5


def test_the_validation_split_of_the_data_set_comes_first(settings, boxes):
    indices = training_indices(settings(), boxes)
    assert (indices.train, indices.select) == (boxes.split("train"), boxes.split("val"))


def test_without_one_the_share_of_each_class_is_held_out_of_train(settings, boxes):
    boxes.records = [r for r in boxes.records if r.split != "val"]
    indices = training_indices(settings(), boxes)
    assert sorted(indices.train + indices.select) == boxes.split("train")
    assert Counter(boxes.records[i].label for i in indices.select) == {0: 1, 1: 1, 2: 1, 3: 1}


def test_choosing_by_test_holds_nothing_out(settings, boxes):
    indices = training_indices(settings(select="test"), boxes)
    assert (indices.train, indices.select) == (boxes.split("train"), boxes.split("test"))
    assert "test" in indices.selected_by


def test_too_few_shapes_are_a_clear_error(settings, boxes):
    boxes.records = boxes.records[:1] + [r for r in boxes.records if r.split == "val"]
    with pytest.raises(DataError, match="1 shapes to train on in builtin:boxes"):
        training_indices(settings(), boxes)


def test_the_shapes_shown_come_from_every_class(settings, boxes):
    labels = [record.label for record in boxes.records]
    shown = shown_indices(training_indices(settings(), boxes), labels, 8)
    assert [labels[i] for i in shown] == [0, 1, 2, 3] and set(shown) <= set(boxes.split("val"))


@given(st.integers(2, 70), st.integers(1, 16), st.integers(0, 3), st.integers(0, 3))
def test_batches_hold_each_shape_once_and_none_is_left_alone(count, size, seed, epoch):
    indices = list(range(1000, 1000 + count))
    batches = epoch_batches(indices, size, seed, epoch)
    assert sorted(i for batch in batches for i in batch) == indices
    assert batches == epoch_batches(indices, size, seed, epoch)
    if size > 1:
        assert all(2 <= len(batch) <= size + 1 for batch in batches)
        assert all(len(batch) == size for batch in batches[:-1])


def test_epochs_and_seeds_shuffle_in_different_ways():
    orders = {tuple(map(tuple, epoch_batches(list(range(30)), 8, s, e))) for s in range(3) for e in range(3)}
    assert len(orders) == 9


def test_the_randomness_of_a_step_is_its_own():
    seeds = {step_seed(s, e, t) for s in range(10) for e in range(10) for t in range(10)}
    assert len(seeds) == 1000
    assert step_generator(1, 2, 3).initial_seed() == step_generator(1, 2, 3).initial_seed() in seeds


@pytest.mark.parametrize(("classes", "words"), [((), "has no classes"), (("mug",), "has the single class mug")])
def test_one_class_or_none_is_nothing_to_tell_apart(classes, words, boxes, settings):
    boxes.classes = classes
    with pytest.raises(DataError, match=words) as refused:
        training_indices(settings(), boxes)
    assert "CLASS/file" in refused.value.hint
