"""How the threads of a block add up what each has found, in one order whatever their own."""

from __future__ import annotations

from mvtn_cli.core.render.gpu.compiled import THREADS, cuda, device_function


@device_function
def add_up_block(terms, out):
    """Add the rows of `terms` (THREADS, K), shared and changed, into `out` (K,); all threads of a block call this."""
    thread, half = cuda.threadIdx.x, THREADS // 2
    while half > 0:
        cuda.syncthreads()
        if thread < half:
            for term in range(terms.shape[1]):
                terms[thread, term] += terms[thread + half, term]
        half //= 2
    if thread == 0:
        for term in range(terms.shape[1]):
            out[term] = terms[0, term]
