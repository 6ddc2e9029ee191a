"""Compile a numerical kernel with numba, cached on disk where that is possible."""

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

# numba keys its cache by a kernel's own file. What kernels of several files call stands in
# elementary.py: its digest becomes part of every kernel's name, so that an edit there is seen.
_SHARED = hashlib.sha256(Path(__file__).with_name("elementary.py").read_bytes()).hexdigest()[:8]


def compiled(function: F) -> F:
    """Compile ``function`` at its first call; keep the machine code beside the source if we may.

    IEEE arithmetic as written: no fastmath (it changes results between processors), and division
    as in NumPy (inf and nan instead of an exception, which would also stop vectorisation).
    """
    function.__qualname__ += f"_{_SHARED}"
    jit = partial(numba.njit, nogil=True, error_model="numpy", fastmath=False)
    try:
        return cast(F, jit(cache=True)(function))
    except RuntimeError:  # no writable place for a cache: compile in every process
        return cast(F, jit()(function))
