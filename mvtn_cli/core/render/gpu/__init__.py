"""The renderer on CUDA: the same pictures and gradients, by kernels made of the functions that draw on the CPU.

Nothing here is imported before a tensor on a CUDA device asks for a picture; it needs `numba-cuda` (extra `cuda`).
"""
