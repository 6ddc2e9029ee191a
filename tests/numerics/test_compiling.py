"""Kernels work, and quietly, wherever machine code may be kept, and where it may not."""

import os
import tempfile
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import numba
import numpy as np
import pytest

import benchmarks
import deqmcl_gym
import localizers
from deqmcl_gym.numerics import compiling


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The system's folder of temporary files, and a fresh look at it."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    compiling.private_folder.cache_clear()
    yield tmp_path
    compiling.private_folder.cache_clear()


@pytest.fixture
def nowhere(monkeypatch):
    """Numba finds none of its own places writable."""
    monkeypatch.setattr("numba.core.caching.InTreeCacheLocator.from_function", lambda *_: None)
    monkeypatch.setattr("numba.core.caching.UserWideCacheLocator.from_function", lambda *_: None)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")


def kernel():
    def double(x):
        return 2 * x

    return compiling.compiled(double)


def test_where_nothing_else_is_writable_the_code_is_kept_in_a_private_temporary_folder(
    nowhere, temporary
):
    double = kernel()
    assert double(np.float64(21)) == 42
    (folder,) = temporary.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert list(folder.rglob("*.nbc"))
    assert numba.config.CACHE_DIR == ""  # other people's kernels stay where they were


def test_without_any_folder_the_kernel_is_compiled_in_each_process(nowhere, temporary, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", "/proc/nowhere")
    assert kernel()(np.float64(21)) == 42
    assert list(temporary.iterdir()) == []


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A kernel's files, index first, and what they hold; afterwards nothing is known of it."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    double = kernel()
    assert (double(np.float64(21)), double(np.int64(21))) == (42.0, 42)
    files = sorted(tmp_path.rglob("*.nb?"), key=lambda path: path.suffix != ".nbi")
    assert [path.suffix for path in files] == [".nbi", ".nbc", ".nbc"]
    return {path: path.read_bytes() for path in files}


def made_anew():
    """Call the kernel as another process would; how many of its two forms were compiled."""
    double = kernel()
    assert (double(np.float64(1.25)), double(np.int64(21))) == (2.5, 42)
    return sum(double.stats.cache_misses.values())


def damages(content, other, rng):
    """Contents that a crash, a full disk or a bad one leaves of a file."""
    yield from (b"", b"\0" * len(content), rng.bytes(len(content)), other)
    for _ in range(8):
        yield content[: rng.integers(len(content))]
        flipped = bytearray(content)
        flipped[rng.integers(len(content))] ^= 1 << rng.integers(8)
        yield bytes(flipped)


def test_damaged_machine_code_is_compiled_again_and_replaced(kept):
    assert made_anew() == 0
    rng = np.random.default_rng(0)
    contents = list(kept.values())
    noticed = 0
    for number, (path, content) in enumerate(kept.items()):
        for damaged in damages(content, contents[number - 1], rng):
            for file, whole in kept.items():
                file.write_bytes(whole)
            path.write_bytes(damaged)
            noticed += made_anew() > 0
            made_anew()
            assert made_anew() == 0, (path.name, damaged[:80])
    assert noticed > 45  # of 60: some bits of an index and of a pickle's frame mean nothing


def test_a_folder_in_place_of_a_file_is_no_reason_to_fail(kept):
    for path in kept:
        path.unlink()
        path.mkdir()
        made_anew()


def test_nothing_is_kept_in_the_working_folder(temporary, monkeypatch):
    monkeypatch.chdir(temporary)
    assert compiling.private_folder() is None
    assert list(temporary.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="temporary folders are private there")
def test_a_folder_that_others_could_write_to_or_have_made_is_not_trusted(temporary, monkeypatch):
    folder = temporary / f"deqmcl-gym-{os.getuid()}"
    folder.mkdir()
    for mode in (0o770, 0o707, 0o755):
        folder.chmod(mode)
        compiling.private_folder.cache_clear()
        assert compiling.private_folder() is None, oct(mode)
    folder.chmod(0o700)
    compiling.private_folder.cache_clear()
    assert compiling.private_folder() == str(folder)

    elsewhere = temporary / "elsewhere"
    folder.rename(elsewhere)
    folder.symlink_to(elsewhere)
    compiling.private_folder.cache_clear()
    assert compiling.private_folder() is None

    other = os.getuid() + 1
    (temporary / f"deqmcl-gym-{other}").mkdir(mode=0o700)
    monkeypatch.setattr(os, "getuid", lambda: other)
    compiling.private_folder.cache_clear()
    assert compiling.private_folder() is None


def test_kernels_call_only_their_own_file_and_those_whose_edits_every_cache_notices():
    seen = set()
    for package in (deqmcl_gym, localizers, benchmarks):
        for module in walk_packages(package.__path__, f"{package.__name__}."):
            if "kernels" in module.name or module.name.startswith("deqmcl_gym."):
                seen.add(module.name)
                for value in vars(import_module(module.name)).values():
                    if hasattr(value, "py_func"):
                        file = Path(value.py_func.__code__.co_filename)
                        own = value.py_func.__module__ == module.name
                        assert own or file in compiling._KERNELS, (module.name, file)
    assert {"localizers.inference.weight_kernels", "deqmcl_gym.world.sensor"} <= seen
