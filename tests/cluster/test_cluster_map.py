"""Work on many machines: who may do it, how much of it is under way, and what is said when it can't be done."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from errands import refuse_seven, square, square_slowly
from hypothesis import given
from hypothesis import strategies as st

from mvtn_cli.config import PreprocessConfig
from mvtn_cli.console import Console
from mvtn_cli.core.cluster import Cluster, connect, connecting, cut
from mvtn_cli.core.cluster.badge import Badge
from mvtn_cli.core.cluster.cluster import AHEAD
from mvtn_cli.errors import MvtnError, UsageError

QUIET = Console(quiet=True)
NOWHERE = "tcp://127.0.0.1:9"


def without_markers(folder: Path) -> bool:
    return not list(folder.glob(".cluster-*"))


@given(count=st.integers(0, 5000), threads=st.integers(1, 300))
def test_pieces_are_all_things_in_order_enough_for_all_and_never_large(count: int, threads: int):
    pieces = list(cut(range(count), threads))
    assert [thing for piece in pieces for thing in piece] == list(range(count))
    assert all(1 <= len(piece) <= 64 for piece in pieces)
    assert len(pieces) >= min(count, 16 * threads)


def test_results_come_back_and_few_pieces_are_under_way(cluster, tmp_path):
    taken = 0

    def pieces() -> Iterator[int]:
        nonlocal taken
        for number in range(60):
            taken += 1
            yield number

    found = []
    with connect(cluster.address, tmp_path, QUIET) as workers:
        assert workers.threads == 2
        assert not without_markers(tmp_path)
        for result in workers.map(square_slowly, pieces()):
            found.append(result)
            assert taken - len(found) <= 2 * (1 + AHEAD)
    assert sorted(found) == [number * number for number in range(60)]
    assert without_markers(tmp_path)


def test_nothing_to_do_is_done_at_once(cluster, tmp_path):
    with connect(cluster.address, tmp_path, QUIET) as workers:
        assert list(workers.map(square, [])) == []


def test_an_error_of_the_work_arrives_with_its_hint_and_ends_the_rest(cluster, tmp_path):
    with connect(cluster.address, tmp_path, QUIET) as workers, pytest.raises(MvtnError) as caught:
        list(workers.map(refuse_seven, range(1000)))
    assert (caught.value.message, caught.value.hint, caught.value.code) == (
        "seven is refused", "take another", "test.seven",
    )  # fmt: skip


def test_whoever_stops_early_takes_back_what_was_sent(cluster, tmp_path):
    from distributed import Client

    with Client(cluster.address) as watcher, connect(cluster.address, tmp_path, QUIET) as workers:
        with closing(workers.map(square_slowly, range(10_000))) as results:
            next(results)
        assert not _unfinished(watcher)


def _unfinished(client: Any) -> list[str]:
    import time

    for _ in range(200):
        left = client.run_on_scheduler(
            lambda dask_scheduler: [k for k, t in dask_scheduler.tasks.items() if t.state != "memory"]
        )
        if not left:
            return []
        time.sleep(0.02)
    return left


@pytest.mark.parametrize(
    ("badge", "code", "words"),
    [
        (Badge("0.0.0", ()), "cluster.other-version", "install the same version"),
        (Badge("", (("/nowhere/at/all", 3),)), "cluster.not-shared", "same path on all machines"),
    ],
)
def test_workers_that_are_not_alike_are_refused_by_name_also_if_they_come_late(
    cluster, tmp_path, monkeypatch, badge, code, words
):
    from mvtn_cli import __version__

    badge = Badge(badge.version or __version__, badge.files)
    with connect(cluster.address, tmp_path, QUIET) as workers:  # they were alike
        late = Cluster(workers._client, cluster.address, badge)
        with pytest.raises(MvtnError, match=r"the worker at tcp://127\.0\.0\.1:\d+") as caught:
            list(late.map(square, range(3)))
        assert caught.value.code == code

    @contextmanager
    def other(*_: Any) -> Iterator[Badge]:
        yield badge

    monkeypatch.setattr(connecting, "badge_of", other)
    with pytest.raises(MvtnError, match=r"the worker at tcp://127\.0\.0\.1:\d+") as caught:
        connect(cluster.address, tmp_path, QUIET).__enter__()
    assert caught.value.code == code and words in caught.value.hint


def versions(**changed: str | None) -> dict[str, Any]:
    same = {"mvtn": "1.0", "python": "3.11.7.final.0", "numpy": "2.0"}
    return {
        "client": {"packages": same},
        "scheduler": {"packages": same},
        "workers": {"tcp://a:1": {"packages": same}, "tcp://b:2": {"packages": {**same, **changed}}},
    }


def test_versions_are_compared_on_every_machine():
    err = io.StringIO()
    console = Console(err=err)
    connecting._check_packages(versions(python="3.11.9.final.0"), console)
    assert not err.getvalue()
    for changed, words in (
        ({"mvtn": "0.9"}, "the worker at tcp://b:2 has mvtn 0.9, this machine 1.0"),
        ({"mvtn": None}, "the worker at tcp://b:2 has no mvtn, this machine 1.0"),
        ({"python": "3.12.1.final.0"}, "the worker at tcp://b:2 runs Python 3.12, this machine 3.11"),
    ):
        with pytest.raises(MvtnError) as caught:
            connecting._check_packages(versions(**changed), console)
        assert caught.value.message == words and caught.value.code == "cluster.other-version"
    scheduler = versions()
    scheduler["scheduler"] = versions(mvtn="0.9")["workers"]["tcp://b:2"]
    with pytest.raises(MvtnError, match=r"the scheduler has mvtn 0\.9"):
        connecting._check_packages(scheduler, console)
    connecting._check_packages(versions(numpy="1.26"), console)
    assert console.warnings == ["the cluster has other versions of numpy: last bits may differ"]


def test_a_scheduler_that_is_not_there_is_waited_for_briefly(tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="the extra cluster is not installed")
    monkeypatch.setattr(connecting, "PATIENCE_S", 0.5)
    with pytest.raises(MvtnError, match=f"no Dask scheduler answers at {NOWHERE}") as caught:
        connect(NOWHERE, tmp_path, QUIET).__enter__()
    assert caught.value.code == "cluster.no-scheduler" and "dask scheduler" in caught.value.hint
    assert without_markers(tmp_path)


def test_a_scheduler_without_workers_is_told_apart(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="the extra cluster is not installed")
    monkeypatch.setattr(connecting, "PATIENCE_S", 2.0)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0", protocol="tcp://") as empty,
        pytest.raises(MvtnError, match="has no workers") as caught,
    ):
        connect(empty.scheduler_address, tmp_path, QUIET).__enter__()
    assert caught.value.code == "cluster.no-workers" and f"dask worker {empty.scheduler_address}" in caught.value.hint


def test_without_dask_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match="--scheduler needs Dask") as caught:
        connect(NOWHERE, tmp_path, QUIET).__enter__()
    assert "pip install mvtn[cluster]" in caught.value.hint


def test_dead_workers_and_a_lost_scheduler_are_errors_in_one_sentence():
    distributed = pytest.importorskip("distributed", reason="the extra cluster is not installed")
    from distributed.client import FutureCancelledError

    def failing(error: Exception) -> Any:
        def result() -> None:
            raise error

        return SimpleNamespace(result=result)

    workers = Cluster(None, NOWHERE, Badge("", ()))
    for error, code in (
        (distributed.KilledWorker("piece", None, 3), "cluster.killed"),
        (FutureCancelledError("piece", "scheduler-connection-lost"), "cluster.lost"),
    ):
        with pytest.raises(MvtnError) as caught:
            workers._result(failing(error))
        assert caught.value.code == code and caught.value.hint


@pytest.mark.parametrize("address", ["localhost", "tcp://host", "http://host:8786", "tcp://:1", "tcp://a b:1"])
def test_an_address_that_can_be_none_is_refused(address: str):
    with pytest.raises(ValueError, match="scheduler"):
        PreprocessConfig(scheduler=address)
    assert PreprocessConfig(scheduler="tcp://[::1]:8786").scheduler
