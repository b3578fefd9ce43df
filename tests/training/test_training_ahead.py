"""One batch is loaded ahead: in order, not more than one, with its errors where they belong."""

from __future__ import annotations

import threading
from functools import partial

import pytest

from mvtn_cli.core.training.ahead import one_ahead


def test_results_come_in_order_and_the_next_one_is_made_meanwhile():
    begun = [threading.Event() for _ in range(4)]

    def make(number: int) -> tuple[int, int]:
        begun[number].set()
        return number, threading.get_ident()

    with one_ahead([partial(make, number) for number in range(4)]) as results:
        for number, (made, thread) in enumerate(results):
            assert made == number and thread != threading.get_ident()
            assert number == 3 or begun[number + 1].wait(20)
            assert not any(event.is_set() for event in begun[number + 2 :])


def test_an_error_comes_in_place_of_its_result():
    def fail() -> int:
        raise ValueError("broken")

    with one_ahead([lambda: 1, fail, lambda: 3]) as results:
        assert next(results) == 1
        with pytest.raises(ValueError, match="broken"):
            next(results)


def test_leaving_early_ends_the_thread():
    before, made = threading.active_count(), []
    with one_ahead([partial(made.append, number) for number in range(9)]) as results:
        next(results)
    assert threading.active_count() == before and len(made) <= 2


def test_nothing_to_load_gives_nothing():
    with one_ahead([]) as results:
        assert list(results) == []
