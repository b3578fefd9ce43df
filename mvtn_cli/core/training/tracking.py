"""The numbers of a training for other programs to watch: TensorBoard's event files, beside metrics.jsonl."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from mvtn_cli.core.training.checkpoint import finite_or_null
from mvtn_cli.core.training.run import Run
from mvtn_cli.errors import MvtnError

FOLDER = "tensorboard"
Track = Callable[[dict[str, Any]], None]


def require(log: str) -> None:
    """Say before any work that a log can't be written.

    Raises:
        MvtnError: TensorBoard is wanted and not installed.
    """
    if log == "tensorboard":
        _writer_class()


@contextmanager
def open_log(log: str, run: Run) -> Iterator[Track]:
    """Give a function that takes the records of metrics.jsonl, each after it was appended there.

    Args:
        log: "none", or "tensorboard": event files in RUN/tensorboard, a scalar a number, named as in the record,
            by epoch. A training that goes on adds a file, which takes the place of what older ones say of the
            same epochs; where there is none yet, it begins with the epochs that are done.
        run: The training.
    """
    writers: list[Any] = []

    def track(record: dict[str, Any]) -> None:
        if not writers:  # as late as that: now it is known with which epoch the training went on
            writers.append(_open(run, record["epoch"]))
        _add(writers[0], record)

    try:
        yield track if log == "tensorboard" else lambda record: None
    finally:
        for writer in writers:
            writer.close()


def _open(run: Run, epoch: int) -> Any:
    folder = run.path / FOLDER
    begun = any(folder.glob("events.*"))
    writer = _writer_class()(folder, purge_step=epoch if begun else None)
    for record in [] if begun else run.metrics():
        if record["epoch"] < epoch:
            _add(writer, record)
    return writer


def _add(writer: Any, record: dict[str, Any]) -> None:
    for name, value in finite_or_null(record).items():  # as metrics.jsonl has them
        if name != "epoch" and isinstance(value, int | float):
            writer.add_scalar(name, value, record["epoch"])
    writer.flush()


def _writer_class() -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise MvtnError(
            "--log tensorboard needs the package tensorboard, which is not installed",
            hint="pip install mvtn[tensorboard], or leave --log out: metrics.jsonl has the same numbers",
            code="training.tensorboard",
        ) from None
    return SummaryWriter
