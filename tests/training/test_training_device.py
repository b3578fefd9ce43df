"""Threads are as many as were asked for."""

from __future__ import annotations

import subprocess
import sys

from processes import environment

ASK = """
import torch, numba
from mvtn_cli.core.bench.timing import threads
from mvtn_cli.core.training.device import use_threads

torch.get_num_threads()  # as any work of torch's does: it settles what its default is
{act}
    print(numba.get_num_threads(), torch.get_num_threads())
"""


def threads_after(act: str) -> str:
    """In a process whose renderer has not started its threads yet: starting them sets torch's, too."""
    words = [sys.executable, "-c", ASK.format(act=act)]
    several = environment(NUMBA_NUM_THREADS="2", OMP_NUM_THREADS="2", NUMBA_THREADING_LAYER="omp")
    ended = subprocess.run(words, env=several, capture_output=True, text=True, timeout=100, check=True)
    return ended.stdout


def test_one_thread_is_one_for_networks_and_for_the_renderer():
    assert threads_after("if not use_threads(1):") == "1 1\n"


def test_a_measurement_with_one_thread_has_one():
    assert threads_after("with threads(1):") == "1 1\n"
