"""Where a training stands: what has to be saved to go on as if it had never stopped."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from statistics import median
from typing import Any

from torch import nn
from torch.optim import Optimizer

from mvtn_cli.core.training.checkpoint import read_state, write_state, write_weights
from mvtn_cli.core.training.run import Run

FORMAT = 1


@dataclass
class Tally:
    """Running sums of the epoch at hand.

    Attributes:
        loss: Sum over shapes.
        correct: Shapes classified right while training.
        shapes: Shapes in the steps that were taken.
        skipped: Steps that were not, for want of finite numbers.
        gradient_norms: Of the viewpoint network, before clipping, one a step.
        seconds: Spent so far.
    """

    loss: float = 0.0
    correct: int = 0
    shapes: int = 0
    skipped: int = 0
    gradient_norms: list[float] = field(default_factory=list)
    seconds: float = 0.0

    def add(self, loss: float, correct: int, shapes: int) -> None:
        """Count a step: its mean loss, how many shapes it got right, of how many."""
        self.loss += loss * shapes
        self.correct += correct
        self.shapes += shapes

    def summary(self) -> dict[str, Any]:
        """The training's part of a line of metrics.jsonl."""
        return {
            "train_loss": self.loss / self.shapes if self.shapes else None,
            "train_accuracy": self.correct / self.shapes if self.shapes else None,
            "view_grad_norm": median(self.gradient_norms) if self.gradient_norms else None,
            "skipped_steps": self.skipped,
            "seconds": round(self.seconds, 3),
        }


@dataclass
class Position:
    """Where a training stands.

    Attributes:
        epoch: Complete epochs.
        step: Steps done in the epoch after them.
        bad_in_a_row: Skipped steps since the last good one.
        best: Number, `val_accuracy` and `val_loss` of the best epoch so far.
        tally: Running sums of the epoch at hand.
    """

    epoch: int = 0
    step: int = 0
    bad_in_a_row: int = 0
    best: dict[str, Any] | None = None
    tally: Tally = field(default_factory=Tally)

    def next_epoch(self) -> None:
        """Come to the start of the next epoch."""
        self.epoch, self.step, self.tally = self.epoch + 1, 0, Tally()


def save(run: Run, position: Position, model: nn.Module, optimisers: dict[str, Optimizer]) -> None:
    """Write the whole state as one file, then the weights once more for other readers.

    Schedules and random numbers are functions of the position and need no state. If the process dies between
    the two files, last.safetensors is one save older than state.pt; going on reads state.pt alone.
    """
    weights = {name: tensor.detach().cpu() for name, tensor in model.state_dict().items()}
    state = {
        "format": FORMAT,
        "position": asdict(position),
        "weights": weights,
        "optimisers": {name: optimiser.state_dict() for name, optimiser in optimisers.items()},
    }
    write_state(run.state_path, state)
    write_weights(run.weights_path("last"), weights, {"epoch": position.epoch, "step": position.step})


def restore(run: Run, model: nn.Module, optimisers: dict[str, Optimizer]) -> Position:
    """Read the state into model and optimisers; nothing happens if the run has none yet.

    Lines of metrics.jsonl that are newer than the state are to be cut: those epochs come again.
    """
    position = Position()
    if run.state_path.exists():
        state = read_state(run.state_path)
        model.load_state_dict(state["weights"])
        for name, optimiser in optimisers.items():
            optimiser.load_state_dict(state["optimisers"][name])
        kept = state["position"]
        position = Position(**{**kept, "tally": Tally(**kept["tally"])})
    return position
