"""Compilation of numerical kernels with numba, cached on disk if possible."""

import contextlib
import hashlib
import multiprocessing
import os
import pickle
import stat
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache, UserProvidedCacheLocator
from numba.core.registry import CPUDispatcher

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile ``function`` at its first call and cache the machine code on disk.

    The cache is the first writable one of: ``NUMBA_CACHE_DIR``, a folder beside the source, the
    user's cache folder, a private temporary folder. If none is writable, or there are no sources
    (in a zip, or of .pyc files alone), nothing is cached.

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
    """Return a digest of what a kernel is made from, which becomes part of its name; "" if unknown.

    numba keys its cache by the kernel's own file, but a kernel has those that it calls in it, and
    constants: so what its file has imported counts, kernels by their names, which have digests too.
    """
    file = function.__code__.co_filename
    try:
        digest = hashlib.sha256(_source(file))
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


@cache
def _source(file: str) -> bytes:
    return Path(file).read_bytes()


class _PrivateFolder(UserProvidedCacheLocator):  # type: ignore[misc]
    """Keeps machine code in our private folder."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)
        subfolder = self.get_suitable_cache_subpath(py_file)
        self._cache_path = os.path.join(private_folder() or "", subfolder)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        # skips the parent, which requires NUMBA_CACHE_DIR
        own: Any = super(UserProvidedCacheLocator, cls)
        return own.from_function(py_func, py_file) if private_folder() else None


class _Signed(CompileResultCacheImpl):  # type: ignore[misc]
    """Machine code with a checksum, as numba would run code from a damaged file."""

    _locator_classes = [*CompileResultCacheImpl._locator_classes, _PrivateFolder]

    def reduce(self, cres: Any) -> Any:
        content = pickle.dumps(super().reduce(cres))
        return hashlib.sha256(content).digest(), content

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        checksum, content = payload
        if hashlib.sha256(content).digest() != checksum:
            raise ValueError("the file is damaged")
        return super().rebuild(target_context, pickle.loads(content))


class _Cache(FunctionCache):  # type: ignore[misc]
    """numba's cache, in which an unusable file counts as missing."""

    _impl_class = _Signed

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            found = super().load_overload(sig, target_context)
        except Exception:  # unpickling a damaged file can raise anything
            found = None
        if found is not None and tuple(found.signature.args) != tuple(sig):
            self._forget()  # the index is damaged: it names another signature's code
            found = None
        if found is None:
            _say_compiling()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except Exception:  # the index is damaged, or the disk full
            self._forget()
            with contextlib.suppress(Exception):
                super().save_overload(sig, data)

    def _forget(self) -> None:
        with contextlib.suppress(OSError):
            self.flush()


_tells = True


def leave_untold() -> None:
    """Say nothing of compiling in this process: the one that started it does."""
    global _tells  # noqa: PLW0603
    _tells = False


@cache
def _say_compiling() -> None:
    """Tell who sits there, once, that it is the compiler; workers leave it to who started them."""
    watched = "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty())
    if watched and _tells and multiprocessing.parent_process() is None:
        words = "deqmcl_gym: compiling kernels: a minute at most, at their first use only"
        print(words, file=sys.stderr, flush=True)


@cache
def private_folder() -> str | None:
    """Return a temporary folder that only this user can write to; None if there is none.

    Cached machine code is executed, so it must not come from a folder that another user made.
    """
    user = os.getuid() if hasattr(os, "getuid") else None  # Windows: temporary folders are private
    try:
        root = Path(tempfile.gettempdir())
        if root == Path.cwd():  # Python's last resort: nobody would look for a cache there
            return None
        folder = root / f"deqmcl-gym-{'cache' if user is None else user}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
    return str(folder) if user is None or (private and found.st_uid == user) else None
