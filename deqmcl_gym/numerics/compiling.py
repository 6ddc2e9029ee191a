"""Compilation of numerical kernels with numba, cached on disk if possible."""

import contextlib
import hashlib
import multiprocessing
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core.caching import FunctionCache
from numba.core.registry import CPUDispatcher

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile ``function`` at its first call and cache the machine code on disk.

    The cache is the first writable one of: ``NUMBA_CACHE_DIR``, a folder beside the source, the
    user's cache folder. If none is writable, or there are no sources (in a zip, or of .pyc files
    alone), nothing is cached.

    IEEE arithmetic as written: no fastmath (it changes results between processors), and division
    as in NumPy (inf and nan instead of an exception, which would also stop vectorisation).
    """
    digest = _digest(function)
    function.__qualname__ += f"_{digest}"
    kernel: Any = numba.njit(nogil=True, error_model="numpy", fastmath=False)(function)
    if digest and not cast(Any, numba.config).DISABLE_JIT:
        with contextlib.suppress(RuntimeError):  # no folder can be written to
            kernel._cache = _Cache(function)
    return cast(F, kernel)


def _digest(function: Callable[..., Any]) -> str:
    """Return a digest of what a kernel is made from, a part of its name; "" if unknown."""
    # numba keys its cache by the kernel's own file, but it has in it what that has imported
    file = function.__code__.co_filename
    try:
        digest = hashlib.sha256(Path(file).read_bytes())
    except OSError:
        return ""
    for name, value in sorted(function.__globals__.items()):
        if isinstance(value, CPUDispatcher):
            if value.py_func.__code__.co_filename != file:
                digest.update(f"{name} {value.py_func.__qualname__}\0".encode())
        elif isinstance(value, bool | int | float | tuple | np.ndarray):
            content = value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
            digest.update(name.encode() + content)
    return digest.hexdigest()[:8]


class _Cache(FunctionCache):  # type: ignore[misc]
    """numba's cache, in which an unusable file counts as missing."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            kernel = super().load_overload(sig, target_context)
        except Exception:  # unpickling a damaged file can raise anything
            kernel = None
        if kernel is None:
            _say_compiling()
        return kernel

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except Exception:  # the index is damaged, or the disk full
            with contextlib.suppress(Exception):
                self.flush()
                super().save_overload(sig, data)


_tells = True


def leave_untold() -> None:
    """Say nothing of compiling in this process: the one that started it does."""
    global _tells  # noqa: PLW0603
    _tells = False


@cache
def _say_compiling() -> None:
    """Tell the user, once, that kernels are being compiled; worker processes do not."""
    watched = "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty())
    if watched and _tells and multiprocessing.parent_process() is None:
        words = "deqmcl_gym: compiling kernels: a minute at most, at their first use only"
        print(words, file=sys.stderr, flush=True)
