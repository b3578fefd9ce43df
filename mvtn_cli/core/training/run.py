"""A training on disk: one folder with its settings, its numbers epoch by epoch, and its weights.

runs/NAME/
  config.toml              every setting; `mvtn train --config` of it goes on with it
  run.json                 classes, data set and its address, version, seed, state
  metrics.jsonl            one line an epoch
  state.pt                 all that going on needs, weights included, written as one file
  last.safetensors         the newest weights
  best.safetensors         the weights of the best epoch, and best.json which one that was
  views_start.npz, views_best.npz   what the cameras saw of a few shapes, before learning and at its best
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w
from filelock import FileLock, Timeout

from mvtn_cli import __version__
from mvtn_cli.config import TrainConfig
from mvtn_cli.core.training.checkpoint import finite_or_null, write_json, write_run_file
from mvtn_cli.errors import DataError, MvtnError, UsageError, choose_error

# None of these changes what a training computes (the data are compared by address).
NOT_SETTINGS = frozenset({"dataset", "name", "runs", "cache", "device", "threads", "workers", "log"})


@dataclass(frozen=True)
class Run:
    """The folder of one training.

    Attributes:
        path: Where it is.
    """

    path: Path

    # Make and find

    @classmethod
    def create(cls, path: Path, config: TrainConfig, prepared: Any) -> Run:
        """Begin a run in a folder that is not there yet.

        Args:
            path: Its folder.
            config: The settings; what is kept of them names the data set that was really taken.
            prepared: The data set: `spec`, `title`, `classes`, `known_view`, `address` and `settings` are kept.
        """
        run = cls(path)
        path.mkdir(parents=True, exist_ok=True)
        # Paths to the user's folders stay out, so that the folder can be taken elsewhere.
        kept = config.model_dump(mode="json", exclude_none=True, exclude={"runs", "cache"})
        write_run_file(run.config_path, tomli_w.dumps({**kept, "dataset": prepared.spec}).encode())
        run._write_info(
            {
                "name": path.name,
                "state": "running",
                "classes": list(prepared.classes),
                "dataset": prepared.spec,
                "title": prepared.title,
                "data_address": prepared.address,
                "preprocess": prepared.settings.as_dict(),
                "known_view": prepared.known_view,
                "version": __version__,
                "seed": config.seed,
                "select": config.select,
                "created": time.time(),
            }
        )
        return run

    @classmethod
    def open(cls, path: Path | str, runs: Path | str = "runs") -> Run:
        """Open a run by its folder or by its name in `runs`.

        Raises:
            UsageError: There is no such run.
        """
        for folder in (Path(path), Path(runs) / path):
            if (folder / "run.json").is_file():
                return cls(folder)
        raise choose_error("run", str(path), [run.label(Path(runs)) for run in cls.all(runs)])

    @classmethod
    def latest(cls, runs: Path | str = "runs") -> Run:
        """Open the run that was worked on last and has weights.

        Raises:
            DataError: There is none.
        """
        found = [run for run in cls.all(runs) if run.weights_path("last").exists()]
        if not found:
            raise DataError(f"no trained run in {runs}", hint="train one first: mvtn train", code="run.none")
        return max(found, key=lambda run: run.info.get("changed", 0.0))

    @classmethod
    def all(cls, runs: Path | str = "runs") -> list[Run]:
        """Every run in a folder, those of comparisons (one folder deeper) included, by name."""
        places = [*Path(runs).glob("*/run.json"), *Path(runs).glob("*/*/run.json")]
        return [cls(place.parent) for place in sorted(places)]

    # What it says

    @property
    def exists(self) -> bool:
        """Whether the folder holds a run."""
        return (self.path / "run.json").is_file()

    @property
    def name(self) -> str:
        """The name of its folder."""
        return self.path.name

    def label(self, runs: Path) -> str:
        """Its name as `--run` takes it, seen from the folder of runs."""
        return self.path.relative_to(runs).as_posix() if self.path.is_relative_to(runs) else str(self.path)

    @property
    def config_path(self) -> Path:
        """The settings file."""
        return self.path / "config.toml"

    @property
    def state_path(self) -> Path:
        """The file that going on needs."""
        return self.path / "state.pt"

    @property
    def metrics_path(self) -> Path:
        """The numbers, one line an epoch."""
        return self.path / "metrics.jsonl"

    def weights_path(self, checkpoint: str = "best") -> Path:
        """The weights file of `best` or `last`."""
        return self.path / f"{checkpoint}.safetensors"

    def require_weights(self, checkpoint: str = "best") -> Path:
        """The weights file of `best` or `last`, which must be there.

        Raises:
            DataError: It is not there yet.
        """
        path = self.weights_path(checkpoint)
        if not path.exists():
            raise DataError(
                f"run {self.name} has no {checkpoint} weights yet",
                hint="finish its training" + ("" if checkpoint == "last" else ", or use --checkpoint last"),
                code="run.no-weights",
            )
        return path

    @property
    def config(self) -> TrainConfig:
        """The settings it was begun with.

        Raises:
            DataError: They can't be read.
        """
        import tomllib

        try:
            settings = tomllib.loads(self.config_path.read_text(encoding="utf-8"))
            return TrainConfig.model_validate(settings)
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise DataError(
                f"can't read the settings in {self.config_path}: {reason}", hint=self._way_out, code="run.config"
            ) from error

    @property
    def info(self) -> dict[str, Any]:
        """The document `run.json`.

        Raises:
            DataError: It can't be read.
        """
        path = self.path / "run.json"
        try:
            return dict(json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError) as error:
            raise DataError(f"can't read {path}: {error}", hint=self._way_out, code="run.info") from error

    @property
    def _way_out(self) -> str:
        return f"put a copy of the file back, or remove {self.path}; other runs can be named: mvtn eval RUN"

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes, in the order of the logits."""
        return tuple(self.info["classes"])

    def check_classes(self, prepared: Any) -> None:
        """Refuse a data set with other classes than those that it was trained on.

        Raises:
            UsageError: It has others, or the same in another order.
        """
        if tuple(prepared.classes) != self.classes:
            raise UsageError(
                f"run {self.name} knows the classes {_some(self.classes)}, and {prepared.spec} has "
                f"{_some(prepared.classes)}",
                hint=f"train on it: mvtn train {prepared.spec}; or ask for the classes of single files: mvtn predict",
                code="run.other-classes",
            )

    @property
    def finished(self) -> bool:
        """Whether the training has come to its end."""
        return self.info["state"] == "finished"

    @property
    def best(self) -> dict[str, Any] | None:
        """Which epoch is the best so far, and its numbers; None before the first."""
        try:
            return dict(json.loads((self.path / "best.json").read_text(encoding="utf-8")))
        except (OSError, ValueError):
            return None

    def metrics(self) -> list[dict[str, Any]]:
        """The lines of metrics.jsonl; a last line that a crash cut off is left out."""
        if not self.metrics_path.exists():
            return []
        records = []
        for line in self.metrics_path.read_text(encoding="utf-8").splitlines():
            try:
                records.append(json.loads(line))
            except ValueError:
                break
        return records

    # What is written to it

    def set_state(self, state: str, **more: Any) -> None:
        """Note `running`, `interrupted` or `finished`, and the time."""
        self._write_info({**self.info, "state": state, **more})

    def append_metrics(self, record: dict[str, Any]) -> None:
        """Add the line of an epoch."""
        with self.metrics_path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(finite_or_null(record), allow_nan=False) + "\n")

    def cut_metrics(self, epochs: int) -> None:
        """Keep the lines of the first epochs only: the ones after them are about to be computed again."""
        kept = [json.dumps(record) + "\n" for record in self.metrics() if record["epoch"] <= epochs]
        write_run_file(self.metrics_path, "".join(kept).encode())

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Keep any other process from training this run.

        Raises:
            MvtnError: One does already.
        """
        lock = FileLock(self.path / ".lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise MvtnError(
                f"{self.path} is being trained by another process",
                hint="wait for it, or begin a run of another name with --name",
                code="run.locked",
            ) from None
        except (OSError, NotImplementedError):
            yield  # no locks on this file system; each write is still whole
            return
        try:
            yield
        finally:
            lock.release()

    def _write_info(self, info: dict[str, Any]) -> None:
        write_json(self.path / "run.json", {**info, "changed": time.time()})


def _some(names: Sequence[str]) -> str:
    return f"{', '.join(names[:3])}{', …' if len(names) > 3 else ''} ({len(names)})"
