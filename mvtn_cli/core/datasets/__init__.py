"""Where labelled shapes come from: one file a distribution, one `open_dataset(spec)`."""

from mvtn_cli.core.datasets.dataset import SPLITS, UNLABELLED, Dataset, Item, Missing
from mvtn_cli.core.datasets.files import unlabelled
from mvtn_cli.core.datasets.opening import open_dataset, survey

__all__ = ["SPLITS", "UNLABELLED", "Dataset", "Item", "Missing", "open_dataset", "survey", "unlabelled"]
