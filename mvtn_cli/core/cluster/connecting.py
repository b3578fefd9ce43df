"""A connection to a Dask cluster, checked before any work goes there."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mvtn_cli.console import Console, counted
from mvtn_cli.core.cluster.badge import Badge, badge_of, other_version
from mvtn_cli.core.cluster.cluster import Cluster
from mvtn_cli.errors import MvtnError, UsageError

PATIENCE_S = 10.0  # for a scheduler to answer, and for a first worker to be there
EXACT = ("numpy", "scipy", "fast-simplification", "torch")  # may change the last bits of what is stored


@contextmanager
def connect(address: str, shared: Path, console: Console, needs: Iterable[Path | str] = ()) -> Iterator[Cluster]:
    """Connect to a scheduler, see that its workers can do the work, and let go of it in the end.

    Args:
        address: As `tcp://host:8786`.
        shared: The artifact directory.
        console: For what is worth knowing.
        needs: Further files that each worker must see under the same path.

    Raises:
        UsageError: The extra is not installed.
        MvtnError: No scheduler answers, it has no workers, or one of them can't do the work.
    """
    client_class = _client_class()
    with _quiet(), badge_of(shared, needs) as badge:
        try:
            client = client_class(address, timeout=PATIENCE_S, name="mvtn")
        except (OSError, ValueError) as error:
            raise MvtnError(
                f"no Dask scheduler answers at {address}",
                hint="start one with `dask scheduler`, and workers with `dask worker ADDRESS`: see docs/scale.md",
                code="cluster.no-scheduler",
            ) from error
        try:
            _check(client, address, badge, console)
            cluster = Cluster(client, address, badge)
            workers = counted(len(client.nthreads()), "worker")
            console.note(f"cluster: {workers}, {counted(cluster.threads, 'thread')} at {address}")
            yield cluster
        finally:
            client.close(timeout=PATIENCE_S)


def _client_class() -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise UsageError(
            "--scheduler needs Dask, which is not installed",
            hint="pip install mvtn[cluster], or leave --scheduler out",
            code="cluster.not-installed",
        ) from None
    return Client


def _check(client: Any, address: str, badge: Badge, console: Console) -> None:
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError:
        raise MvtnError(
            f"the scheduler at {address} has no workers",
            hint=f"start some on each machine: dask worker {address} --nworkers auto --nthreads 1",
            code="cluster.no-workers",
        ) from None
    _check_packages(client.get_versions(packages=["mvtn", *EXACT]), console)
    for worker, found in client.run(_check_there, badge, on_error="return").items():
        if isinstance(found, MvtnError):
            raise found
        if isinstance(found, Exception):
            raise MvtnError(
                f"the worker at {worker} can't run mvtn: {type(found).__name__}: {found}",
                hint="it needs the same Python and the same mvtn as this machine",
                code="cluster.other-version",
            )


def _check_there(badge: Badge, dask_worker: Any) -> None:
    badge.check(f"the worker at {dask_worker.address}")


def _check_packages(versions: Mapping[str, Any], console: Console) -> None:
    """Refuse another mvtn or Python anywhere, the scheduler included: it unpacks what is sent; note other packages."""
    ours = versions["client"]["packages"]
    others = {"the scheduler": versions["scheduler"]} | {
        f"the worker at {address}": found for address, found in versions["workers"].items()
    }
    different: set[str] = set()
    for where, found in others.items():
        theirs = found["packages"]
        if theirs.get("mvtn") != ours.get("mvtn"):
            raise other_version(where, theirs.get("mvtn"), ours.get("mvtn"))
        if _minor(theirs) != _minor(ours):
            raise MvtnError(
                f"{where} runs Python {_minor(theirs)}, this machine {_minor(ours)}",
                hint="use the same on all machines of the cluster",
                code="cluster.other-version",
            )
        different |= {name for name in EXACT if where != "the scheduler" and theirs.get(name) != ours.get(name)}
    if different:
        console.warn(f"the cluster has other versions of {', '.join(sorted(different))}: last bits may differ")


def _minor(packages: Mapping[str, Any]) -> str:
    """Python as `3.11`; Dask tells it as `3.11.7.final.0` or as a printed tuple."""
    return ".".join(str(packages["python"]).strip("()").replace(", ", ".").split(".")[:2])


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's own narration off the terminal: what matters of it ends as one of our errors or warnings."""
    loggers = [logging.getLogger(name) for name in ("distributed", *_children("distributed"))]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="distributed")
            yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def _children(name: str) -> list[str]:
    return [found for found in logging.root.manager.loggerDict if found.startswith(f"{name}.")]
