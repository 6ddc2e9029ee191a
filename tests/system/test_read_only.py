"""An install that nobody can write to works, and keeps quiet, for who has no home."""

import ctypes
import os
import shutil
import sys
from pathlib import Path

import pytest
from deqmcl_command import process

ROOT = Path(__file__).parents[2]
COMMAND = "import sys; from benchmarks.cli import main; sys.exit(main(sys.argv[1:]))"
DROP_FROM_BOUNDING_SET, DAC_OVERRIDE = 24, 1  # prctl(2), capabilities(7)


def heed_permissions() -> None:
    """Make them hold for root, too, from the next program on."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(DROP_FROM_BOUNDING_SET, DAC_OVERRIDE, 0, 0, 0)


@pytest.fixture(scope="module")
def locked(tmp_path_factory):
    """The three packages, and a home, in folders without permission to write."""
    root = tmp_path_factory.mktemp("install")
    for package in ("benchmarks", "deqmcl_gym", "localizers"):
        left = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, root / package, ignore=left)
    (root / "home").mkdir()
    folders = [path for path in (root, *root.rglob("*")) if path.is_dir()]
    for path in folders:
        path.chmod(0o555)
    yield root
    for path in folders:
        path.chmod(0o755)


def run(locked, temporary, *arguments):
    bare = {"PATH": os.environ["PATH"], "PYTHONPATH": str(locked), "HOME": str(locked / "home")}
    done = process(
        *(sys.executable, "-W", "error", "-c", *arguments),
        cwd=locked,
        env=bare | {"TMPDIR": str(temporary)},
        preexec_fn=heed_permissions,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def untouched(locked):
    return not list(locked.rglob("__pycache__")) and not list((locked / "home").iterdir())


@pytest.mark.slow
def test_the_papers_run_works_without_a_folder_for_its_kernels(locked, tmp_path):
    paper = ("paper", "--trials", "1", "--particles", "10", "--out", tmp_path / "out")
    said = run(locked, tmp_path, COMMAND, *paper, "--jobs", "2")
    assert "figures/lap.webp" in said
    assert not list(tmp_path.rglob("*.nbc"))
    assert untouched(locked)
