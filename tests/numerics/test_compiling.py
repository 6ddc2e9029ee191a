"""Kernels work, and quietly, wherever machine code may be kept or not, and in pure Python."""

import compileall
import json
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from importlib import import_module, invalidate_caches
from pathlib import Path

import kernel_cases
import numba
import numpy as np
import pytest

import deqmcl_gym
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
    for _ in range(4):
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
    assert noticed > 24  # of 36: some bits of an index and of a pickle's frame mean nothing


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
        compiling._source.cache_clear()
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
import benchmarks.trials.attempt
from numba.core.registry import CPUDispatcher
ours = [m for name, m in sys.modules.items() if name.startswith(("deqmcl_gym", "localizers"))]
kernels = {k.py_func for m in ours for k in vars(m).values() if isinstance(k, CPUDispatcher)}
print(*sorted(f"{k.__module__} {k.__qualname__}" for k in kernels), sep=",")
"""


def test_the_names_of_all_kernels_are_the_same_in_every_process(capsys):
    command, own = [sys.executable, "-c", NAMES], os.environ | {"PYTHONHASHSEED": "1"}
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=own)
    exec(NAMES, {})
    assert set(done.stdout.strip().split(",")) <= set(capsys.readouterr().out.strip().split(","))
    assert done.stdout.count("deqmcl_gym.maps") > 20


def test_every_kernel_file_says_the_same_compiled_and_in_pure_python():
    said = subprocess.run(
        [sys.executable, "-W", "ignore", kernel_cases.__file__],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert json.loads(said) == kernel_cases.digests()


@pytest.mark.parametrize("form", ["zip", "pyc"])
def test_without_sources_kernels_work_too_and_none_is_kept(tmp_path, form):
    package = Path(deqmcl_gym.__file__).parent
    for own in (package, package.parent / "localizers"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(own, tmp_path / "there" / own.name, ignore=ignored)
    place = tmp_path / "there"
    if form == "zip":
        place = shutil.make_archive(str(tmp_path / "there"), "zip", tmp_path / "there")
    else:
        compileall.compile_dir(place, quiet=1, legacy=True)
        for source in place.rglob("*.py"):
            source.unlink()
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import deqmcl_gym, localizers;"
        "print(deqmcl_gym.__file__);"
        "from deqmcl_gym.numerics import arrays;"
        "print(deqmcl_gym.GridMap.load and localizers.make and arrays.sin([0.0])[0])"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, str(place)],
        env=os.environ | {"PYTHONPATH": ""}, cwd=tmp_path, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [f"{place}/deqmcl_gym/__init__.py{'c' * (form == 'pyc')}", "0.0"]
    assert not list(tmp_path.rglob("*.nbi"))


def test_who_waits_for_the_compiler_at_a_terminal_is_told_once_and_a_pipe_is_not(
    monkeypatch, capsys
):
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
