"""`open_builtin(spec)`: names, settings and their errors."""

from __future__ import annotations

import pickle
from collections import Counter

import numpy as np
import pytest

from mvtn_cli.core.datasets import open_dataset
from mvtn_cli.core.datasets.builtin import one_sided, open_builtin, shapes
from mvtn_cli.errors import ExitCode, UsageError


def test_default_sizes_are_those_of_the_documentation() -> None:
    everyday, sided = open_builtin("builtin:shapes"), open_builtin("builtin:one-sided")
    assert (everyday.count("train"), everyday.count("test"), everyday.known_view) == (480, 240, False)
    assert (sided.count("train"), sided.count("test"), sided.known_view) == (2304, 480, True)


@pytest.mark.parametrize("name", ["shapes", "one-sided"])
def test_classes_are_balanced_and_names_unique(name: str) -> None:
    data = open_builtin(f"builtin:{name}")
    for split in ("train", "test"):
        counts = Counter(item.label for item in data.items if item.split == split)
        assert set(counts) == set(range(len(data.classes)))
        assert len(set(counts.values())) == 1
    assert len({item.name for item in data.items}) == len(data.items)
    assert all(item.name.startswith(data.classes[item.label] + "/") for item in data.items)


def test_a_first_part_of_a_split_is_balanced_and_a_larger_set_begins_with_the_smaller() -> None:
    small, large = (
        open_builtin("builtin:shapes?train=24&test=0"),
        open_builtin("builtin:shapes?train=36&test=0"),
    )
    assert [item.label for item in small.items] == list(range(12)) * 2
    assert [item.content() for item in small.items] == [item.content() for item in large.items[:24]]


@pytest.mark.parametrize("name", ["shapes", "one-sided"])
def test_items_survive_the_way_to_another_process(name: str) -> None:
    item = open_builtin(f"builtin:{name}?train=13&test=0&seed=4").items[-1]
    other = pickle.loads(pickle.dumps(item))
    assert other.content() == item.content()
    assert np.array_equal(other.read().vertices, item.read().vertices)
    assert other.read().name == item.name
    assert (other.read().known_azimuth_deg is not None) == (name == "one-sided")


@pytest.mark.parametrize(("name", "module"), [("shapes", shapes), ("one-sided", one_sided)])
def test_content_tells_shapes_seeds_splits_and_generator_versions_apart(
    name: str, module: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    items = [item for seed in (0, 1) for item in open_builtin(f"builtin:{name}?train=12&test=12&seed={seed}").items]
    before = [item.content() for item in items]
    assert len(set(before)) == len(items)
    monkeypatch.setattr(module, "VERSION", 99)
    assert not set(before) & {item.content() for item in items}


def test_the_spec_opens_the_same_set_again_and_names_only_what_was_changed() -> None:
    assert open_builtin("builtin:shapes?train=480").spec == "builtin:shapes"
    data = open_builtin("builtin:one-sided?seed=7&train=768")
    assert data.spec == "builtin:one-sided?train=768&seed=7"
    assert open_dataset(data.spec) == data
    assert "6 classes, 768 train, 480 test, seed 7" in data.title


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("builtin:shape", "unknown builtin 'shape'; did you mean 'shapes'"),
        ("builtin:one_sided", "did you mean 'one-sided'"),
        ("builtin:shapes?trian=3", "unknown setting 'trian'; did you mean 'train'"),
        ("builtin:shapes?train=-3", r"train in .* must be a whole number in \[0, 1000000\], got '-3'"),
        ("builtin:shapes?train=abc", "got 'abc'"),
        ("builtin:shapes?train=", "got ''"),
        ("builtin:shapes?train", "got ''"),
        ("builtin:shapes?test=1.5", "got '1.5'"),
        ("builtin:shapes?train=" + "9" * 5000, "must be a whole number"),
        ("builtin:shapes?train=²", "must be a whole number"),
        ("builtin:shapes?train=3&train=4", "train is given twice"),
        ("builtin:shapes?train=0&test=0", "asks for no shapes"),
    ],
)
def test_a_wrong_word_is_named_with_what_was_expected(spec: str, words: str) -> None:
    with pytest.raises(UsageError, match=words) as caught:
        open_builtin(spec)
    assert caught.value.exit_code == ExitCode.USAGE
    assert caught.value.hint
