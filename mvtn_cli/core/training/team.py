"""The processes that train one run together: who they are, and what they exchange besides gradients.

Each computes its share of every batch with the same weights; `draws.py` and `networks/synced.py` see to it that
together they compute what one process would. The first one (rank 0) alone writes files and speaks.
"""

from __future__ import annotations

import inspect
import logging
import os
import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from datetime import timedelta
from functools import cache
from typing import Any, TypeVar

import torch
from lightning_fabric import Fabric
from lightning_fabric.plugins.environments import TorchElasticEnvironment
from lightning_fabric.strategies import DDPStrategy
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from mvtn_cli.console import Console
from mvtn_cli.core.networks.synced import Exchange, Share, synchronise_batch_norm
from mvtn_cli.core.preprocess.mapping import worker_count
from mvtn_cli.core.training.device import choose_device, shared_device
from mvtn_cli.core.training.draws import WholeBatchDraws
from mvtn_cli.core.training.launch import launcher_process, started_with_others
from mvtn_cli.core.training.signals import StopNow
from mvtn_cli.errors import MvtnError

Result = TypeVar("Result")

PATIENCE = timedelta(minutes=30)  # with a process that is alive and does not answer; a dead one is noticed at once
LOST = "train.process-lost"
LOST_WORDS = re.compile(r"gloo|nccl|peer|connection (closed|reset)|broken pipe|socket|timed? ?out", re.IGNORECASE)
# Buffers are not sent around; the option's name depends on the version of torch.
_KNOWN = inspect.signature(DistributedDataParallel).parameters
UNSYNCED: dict[str, Any] = {"forward_sync_buffers" if "forward_sync_buffers" in _KNOWN else "broadcast_buffers": False}


class Team:
    """The processes of a training; most trainings have a single one, for which nothing is exchanged.

    Args:
        fabric: Launched.
        size: Number of processes.
        rank: Of this one, from 0.
        here: Processes on this machine.
    """

    def __init__(self, fabric: Fabric, size: int = 1, rank: int = 0, here: int = 1) -> None:
        self.fabric, self.size, self.rank, self.here = fabric, size, rank, here
        self._told: list[BaseException] = []
        group = distributed.new_group() if size > 1 else None
        self._exchange = Exchange(group, Share(size, rank, size))

    @staticmethod
    def join(device: str) -> Team:
        """Give this process's team: itself, or all that torchrun or `--devices` started.

        Args:
            device: As `--device`.

        Raises:
            UsageError: The device is not there, or there are fewer than processes.
        """
        if started_with_others():
            return _join_others(device)
        place = choose_device(device)
        fabric = Fabric(accelerator=place.type, devices=[place.index] if place.type == "cuda" else 1)
        fabric.launch()
        return Team(fabric)

    # Who says and writes what

    @property
    def first(self) -> bool:
        """Whether this process writes files and speaks."""
        return self.rank == 0

    def console(self, console: Console) -> Console:
        """The console itself for the first process, for all others one that says nothing."""
        return console if self.first else silent_console()

    def agreed(self, error: MvtnError) -> MvtnError:
        """Mark an error that all processes raise at the same place."""
        self._told.append(error)
        return error

    def is_told_elsewhere(self, error: MvtnError) -> bool:
        """Whether another process says this error, or the one that started all of them does."""
        if error.code == LOST:
            return not self.first or launcher_process() is not None
        return not self.first and any(error is told for told in self._told)

    @property
    def threads(self) -> int | None:
        """CPU threads of this process, so that those of one machine share its cores; None for a single one."""
        return None if self.size == 1 else max(1, self.cores // self.here)

    @property
    def cores(self) -> int:
        """Of this machine, that this process may use."""
        return worker_count(None)

    # Work and its outcome

    def together(self, work: Callable[[], Result]) -> Result:
        """Do work in each process; an error of any of them is raised by all.

        Args:
            work: May exchange nothing.
        """
        if self.size == 1:
            return work()
        result, error = None, None
        try:
            result = work()
        except (MvtnError, StopNow) as caught:
            error = caught
        self._raise_first(self.gather(error))
        return result  # type: ignore[return-value]

    def alone(self, work: Callable[[], Result]) -> Result:
        """Do work in the first process; all get its result, or its error."""
        if self.size == 1:
            return work()
        result, error = None, None
        if self.first:
            try:
                result = work()
            except (MvtnError, StopNow) as caught:
                error = caught
        result, error = self.fabric.broadcast((result, error))
        self._raise_first([error])
        return result  # type: ignore[return-value]

    def in_turn(self, work: Callable[[], Result]) -> Result:
        """Do work in the first process, then in the others, which find what it left on disk."""
        if self.first:
            result = self.together(work)
            self.together(lambda: None)
        else:
            self.together(lambda: None)
            result = self.together(work)
        return result

    def _raise_first(self, errors: list[Any]) -> None:
        for error in errors:
            if error is not None:
                self._told.append(error)
                raise error

    # Numbers

    def gather(self, value: Result) -> list[Result]:
        """Everybody's value, by rank."""
        if self.size == 1:
            return [value]
        values: list[Any] = [None] * self.size
        distributed.all_gather_object(values, value)
        return values

    def total(self, *numbers: float) -> list[float]:
        """Sums over the processes."""
        if self.size == 1:
            return list(numbers)
        exact = torch.float32 if self.fabric.device.type == "mps" else torch.float64
        sums = torch.tensor(numbers, dtype=exact, device=self.fabric.device)
        distributed.all_reduce(sums)
        return sums.tolist()

    def mean(self, share: Share, value: float) -> float:
        """The mean over a batch, from the mean over the share of each process."""
        return self.total(share.weight * value)[0]

    def any(self, *flags: bool) -> list[bool]:
        """Which flags are up in at least one process."""
        return [number > 0 for number in self.total(*map(float, flags))]

    # A batch

    def synchronise(self, model: nn.Module) -> None:
        """Let BatchNorm work on whole batches."""
        if self.size > 1:
            synchronise_batch_norm(model, self._exchange)

    def share(self, batch: list[int]) -> Share:
        """Which shapes of a batch are this process's; holds for BatchNorm until the next call."""
        self._exchange.share = self.share_of(batch)
        return self._exchange.share

    def share_of(self, batch: list[int]) -> Share:
        """The same, for a batch whose turn has not come yet."""
        return Share(len(batch), self.rank, self.size)

    def drawing(self, share: Share) -> AbstractContextManager[Any]:
        """What is drawn at random inside, by this thread, is a part of what is drawn for the whole batch."""
        return WholeBatchDraws(share) if self.size > 1 else nullcontext()

    # Its end

    def question(self, stop: Callable[[], bool] | None) -> Callable[[], bool] | None:
        """The caller's question whether to stop, and besides: is the process that started all of them gone?"""
        launcher = launcher_process()
        if launcher is None:
            return stop
        return lambda: os.getppid() != launcher or (stop is not None and stop())

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Turn the many errors by which a lost process shows into one.

        Raises:
            MvtnError: Another process does not answer any more.
        """
        try:
            yield
        except RuntimeError as error:
            if self.size == 1 or not LOST_WORDS.search(str(error)):
                raise
            raise MvtnError(
                f"another of the {self.size} processes of this training has ended, so the others can't go on",
                hint="the same command goes on from what was saved last",
                code=LOST,
            ) from error


def silent_console() -> Console:
    """A console that says nothing at all."""
    nowhere = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  (as long as the process)
    return Console(out=nowhere, err=nowhere, quiet=True)


@cache  # a process can join the others a single time
def _join_others(device: str) -> Team:
    logging.getLogger("lightning_fabric").setLevel(logging.WARNING)
    environment = TorchElasticEnvironment()
    size, rank = environment.world_size(), environment.global_rank()
    here = int(os.environ.get("LOCAL_WORLD_SIZE", size))
    place = shared_device(device, here)
    # Statistics of BatchNorm are the same everywhere; which weights take part depends on the stage of the training.
    strategy = DDPStrategy(find_unused_parameters=True, timeout=PATIENCE, **UNSYNCED)
    fabric = Fabric(
        accelerator=place.type, devices=here, num_nodes=size // here, strategy=strategy, plugins=[environment]
    )
    fabric.launch()
    return Team(fabric, size, rank, here)
