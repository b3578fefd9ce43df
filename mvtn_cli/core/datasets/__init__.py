"""Where labelled shapes come from: one file a distribution, one `open_dataset(spec)`."""

from mvtn_cli.core.datasets.dataset import SPLITS, UNLABELLED, Dataset, Item
from mvtn_cli.core.datasets.files import unlabelled
from mvtn_cli.core.datasets.opening import open_dataset

__all__ = ["SPLITS", "UNLABELLED", "Dataset", "Item", "open_dataset", "unlabelled"]
