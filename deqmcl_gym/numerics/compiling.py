"""Compile a numerical kernel with numba, cached on disk where that is possible."""

import hashlib
import os
import stat
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

# numba keys its cache by a kernel's own file, but kernels call those of other files. A digest of
# all files of kernels becomes part of every kernel's name, so that an edit in any of them is seen.
_ROOT = Path(__file__).parents[2]
_KERNELS = sorted(
    path
    for package in ("deqmcl_gym", "localizers", "benchmarks")
    for pattern in ("*kernels.py", "elementary.py")
    for path in (_ROOT / package).rglob(pattern)
)
_SHARED = hashlib.sha256(b"".join(path.read_bytes() for path in _KERNELS)).hexdigest()[:8]


def compiled(function: F) -> F:
    """Compile ``function`` at its first call; keep the machine code on disk where we may.

    That is ``NUMBA_CACHE_DIR``, beside the source, the user's cache folder, or a private folder
    among the temporary ones, whichever can be written to first; else nowhere.

    IEEE arithmetic as written: no fastmath (it changes results between processors), and division
    as in NumPy (inf and nan instead of an exception, which would also stop vectorisation).
    """
    function.__qualname__ += f"_{_SHARED}"
    jit = partial(numba.njit, nogil=True, error_model="numpy", fastmath=False)
    try:
        return cast(F, jit(cache=True)(function))
    except RuntimeError:  # none of numba's own places can be written to
        return cast(F, _kept_apart(jit, function))


def _kept_apart(jit: Callable[..., Any], function: Callable[..., Any]) -> Any:
    """Compile with a cache in our private folder; without one, in every process anew."""
    folder = private_folder()
    if folder is None:
        return jit()(function)
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, folder
    try:
        return jit(cache=True)(function)
    except RuntimeError:
        return jit()(function)
    finally:
        config.CACHE_DIR = before  # other people's kernels are theirs to place


@cache
def private_folder() -> str | None:
    """Return a temporary folder that only this user can write to; None if there is none.

    Machine code from a cache is run: it must not come from a folder that someone else prepared
    under our name.
    """
    user = os.getuid() if hasattr(os, "getuid") else None  # Windows: temporary folders are private
    try:
        root = Path(tempfile.gettempdir())
        if root == Path.cwd():  # Python's last resort, where nobody looks for it
            return None
        folder = root / f"deqmcl-gym-{'cache' if user is None else user}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
    return str(folder) if user is None or (private and found.st_uid == user) else None
