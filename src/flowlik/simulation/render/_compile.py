"""How the renderer's kernels are compiled.

No fastmath, so that every machine computes the same. Kernels make no arrays (`_nrt=False`), what they
write on is given to them: otherwise numba counts references to every array again and again within the
loops, in atomic operations for which the threads wait on one another. That took half of a picture's time.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from numba import njit

# numba's annotations do not know `_nrt`
_compiled: Any = partial(njit, cache=True, error_model="numpy", _nrt=False)

kernel = _compiled(nogil=True)
"""Decorates a function that stays a function."""

inlined = _compiled(nogil=True, forceinline=True)
"""Decorates a function that is written out where it is called: by LLVM, which is faster at it than numba."""
