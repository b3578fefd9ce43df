"""From files to stored shapes: the parallel map over shapes, its progress and summary."""

from mvtn_cli.core.preprocess.opening import choose_dataset, open_prepared, prepare_files
from mvtn_cli.core.preprocess.part import Part
from mvtn_cli.core.preprocess.prepared import Prepared, Record
from mvtn_cli.core.preprocess.preprocess import prepare, preprocess
from mvtn_cli.core.preprocess.settings import Settings
from mvtn_cli.core.preprocess.summary import Summary

__all__ = [
    "Part",
    "Prepared",
    "Record",
    "Settings",
    "Summary",
    "choose_dataset",
    "open_prepared",
    "prepare",
    "prepare_files",
    "preprocess",
]
