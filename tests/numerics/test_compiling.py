"""Kernels work, and quietly, wherever machine code may be kept or not."""

import compileall
import json
import os
import shutil
import sys
from functools import cache
from importlib import import_module, invalidate_caches
from pathlib import Path

import kernel_cases
import numba
import numpy as np
import pytest
from deqmcl_command import python

import deqmcl_gym
from deqmcl_gym.numerics import compiling


def kernel():
    def double(x):
        return 2 * x

    return compiling.compiled(double)


def test_where_nothing_is_writable_the_kernel_is_compiled_in_each_process(monkeypatch):
    for locator in ("InTree", "UserWide"):
        place = f"numba.core.caching.{locator}CacheLocator.from_function"
        monkeypatch.setattr(place, lambda *_: None)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    assert kernel()(np.float64(21)) == 42


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A kernel's files, index first, and what they hold; afterwards nothing is known of it."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert kernel()(np.float64(21)) == 42
    files = sorted(tmp_path.rglob("*.nb?"), key=lambda path: path.suffix != ".nbi")
    assert [path.suffix for path in files] == [".nbi", ".nbc"]
    return {path: path.read_bytes() for path in files}


def made_anew():
    """Call the kernel as another process would; whether it was compiled."""
    double = kernel()
    assert double(np.float64(1.25)) == 2.5
    return sum(double.stats.cache_misses.values()) > 0


def test_a_file_that_a_crash_or_a_full_disk_left_is_compiled_again_and_replaced(kept):
    assert not made_anew()
    for path, content in kept.items():
        for damaged in (b"", b"\0" * len(content), content[: len(content) // 2]):
            path.write_bytes(damaged)
            assert made_anew()
            made_anew()
            assert not made_anew(), (path.name, damaged[:80])


def test_a_folder_in_place_of_a_file_is_no_reason_to_fail(kept):
    for path in kept:
        path.unlink()
        path.mkdir()
        made_anew()


CALLED = """
from deqmcl_gym.numerics.compiling import compiled
FACTOR = {}
@compiled
def inner(x):
    return {} * x
"""
CALLING = """
from deqmcl_gym.numerics.compiling import compiled
from called import {}
@compiled
def outer(x):
    return below(x)
@compiled
def below(x):
    return {}
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Three files, the second and third of which import from the first; loaded as if anew."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "calling.py").write_text(CALLING.format("inner", "inner(x)"))
    (tmp_path / "scaling.py").write_text(CALLING.format("FACTOR", "FACTOR * x"))

    def loaded(factor, inner):
        (tmp_path / "called.py").write_text(CALLED.format(factor, inner))
        for name in ("called", "calling", "scaling"):
            sys.modules.pop(name, None)
        shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
        invalidate_caches()
        outers = [import_module(name).outer for name in ("calling", "scaling")]
        return [(outer(2.0), sum(outer.stats.cache_misses.values())) for outer in outers]

    yield loaded
    for name in ("called", "calling", "scaling"):
        sys.modules.pop(name, None)


def test_a_kernel_is_compiled_again_exactly_if_what_it_calls_or_a_constant_is_edited(package):
    assert package(3.0, 5.0) == [(10.0, 1), (6.0, 1)]
    assert package(3.0, 5.0) == [(10.0, 0), (6.0, 0)]
    assert package(3.0, 7.0) == [(14.0, 1), (6.0, 0)]  # only what calls it
    assert package(4.0, 7.0)[1] == (8.0, 1)


NAMES = """
import sys
import benchmarks.trials.stage
from numba.core.registry import CPUDispatcher
ours = [m for name, m in sys.modules.items() if name.startswith(("deqmcl_gym", "localizers"))]
kernels = {k.py_func for m in ours for k in vars(m).values() if isinstance(k, CPUDispatcher)}
print(*sorted(f"{k.__module__} {k.__qualname__}" for k in kernels), sep=",")
"""


def test_the_names_of_all_kernels_are_the_same_in_every_process(capsys):
    said = python("-c", NAMES, env=os.environ | {"PYTHONHASHSEED": "1"})
    exec(NAMES, {})
    assert set(said.strip().split(",")) <= set(capsys.readouterr().out.strip().split(","))
    assert said.count("deqmcl_gym.maps") > 20


def test_without_sources_kernels_work_too_and_none_is_kept(tmp_path):
    package = Path(deqmcl_gym.__file__).parent
    for own in (package, package.parent / "localizers"):
        shutil.copytree(own, tmp_path / own.name, ignore=shutil.ignore_patterns("__pycache__"))
    compileall.compile_dir(tmp_path, quiet=1, legacy=True)
    for source in tmp_path.rglob("*.py"):
        source.unlink()
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import deqmcl_gym, localizers;"
        "print(deqmcl_gym.__file__);"
        "from deqmcl_gym.numerics import arrays;"
        "print(deqmcl_gym.GridMap.load and localizers.make and arrays.sin([0.0])[0])"
    )
    bare = os.environ | {"PYTHONPATH": ""}
    said = python("-P", "-c", code, tmp_path, env=bare, cwd=tmp_path)
    assert said.split() == [f"{tmp_path}/deqmcl_gym/__init__.pyc", "0.0"]
    assert not list(tmp_path.rglob("*.nbi"))


def test_who_waits_for_the_compiler_is_told_once_and_a_pipe_is_not(monkeypatch, capsys):
    monkeypatch.setattr(compiling, "_say_compiling", cache(compiling._say_compiling.__wrapped__))
    compiling._say_compiling()
    assert capsys.readouterr().err == ""
    compiling._say_compiling.cache_clear()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    for _ in range(2):
        compiling._say_compiling()
    assert capsys.readouterr().err.count("compiling kernels") == 1
    compiling._say_compiling.cache_clear()
    monkeypatch.setattr(compiling, "_tells", True)  # put back afterwards
    compiling.leave_untold()
    compiling._say_compiling()
    assert capsys.readouterr().err == ""


def test_every_kernel_file_says_the_same_compiled_and_in_pure_python():
    pure = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    said = python("-W", "ignore", kernel_cases.__file__, env=pure)
    assert json.loads(said) == kernel_cases.digests()
