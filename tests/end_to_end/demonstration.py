"""The demo, played once for all tests that only look at what it left behind."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from processes import Ended, Folder

# Enough steps for a signal to come in between, few enough pixels for all of them to take a second.
SETTINGS = """
dataset = "builtin:shapes?train=24&test=12"
image_size = 16
workers = 1
threads = 1

[train]
num_views = 2
epochs = 8
batch_size = 2
encoder_points = 64
"""


@dataclass(frozen=True)
class Demo:
    """What `mvtn preprocess && mvtn train && mvtn eval` and one more `mvtn preprocess` left behind."""

    folder: Folder
    preprocess: Ended
    train: Ended
    evaluate: Ended
    again: Ended

    @property
    def run(self) -> Path:
        """The folder of the run."""
        return self.folder.path / str(self.train.document["run"])


def play_demo(path: Path) -> Demo:
    """Run the commands of the demo one after another."""
    folder = new_folder(path)
    commands = (["preprocess"], ["train", "--json"], ["eval"], ["preprocess"])
    return Demo(folder, *(folder.mvtn(*words) for words in commands))


def new_folder(path: Path) -> Folder:
    """An empty folder but for the tiny settings."""
    path.mkdir()
    (path / "mvtn.toml").write_text(SETTINGS)
    return Folder(path)
