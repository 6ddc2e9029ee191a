"""The wheel, and an install that nobody can write to."""

import ctypes
import os
import shutil
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from deqmcl_command import process, python

import deqmcl_gym

ROOT = Path(__file__).parents[2]
PACKAGES = ("benchmarks", "deqmcl_gym", "localizers")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
COMMAND = "import sys; from benchmarks.cli import main; sys.exit(main(sys.argv[1:]))"
DROP_FROM_BOUNDING_SET, DAC_OVERRIDE = 24, 1  # prctl(2), capabilities(7)


def test_setuptools_builds_the_three_packages_with_their_marks(tmp_path):
    pytest.importorskip("setuptools", reason="a venv of Python 3.12 or later has none")
    for package in PACKAGES:
        left = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=left)
    for other in ("tests", "docs", "results", ".venv"):  # what must not get in
        (tmp_path / other).mkdir()
        (tmp_path / other / "stray.py").write_text("")
    shutil.copy(ROOT / "README.md", tmp_path)
    lines = (ROOT / "pyproject.toml").read_text().splitlines()
    (tmp_path / "pyproject.toml").write_text(  # setuptools older than 77 cannot read the licence
        "\n".join(line for line in lines if not line.startswith("license"))
    )
    build = "from setuptools import setup; setup()"
    python("-c", build, "-q", "build", "--build-lib", "built", cwd=tmp_path)
    built = {p.relative_to(tmp_path / "built") for p in (tmp_path / "built").rglob("*.*")}
    expected = {
        path.relative_to(ROOT)
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if "studies" not in path.parts  # of a clone
        and (
            path.suffix in (".bib", ".css", ".csv", ".jinja", ".py", ".toml")
            or path.name == "py.typed"
        )
    }
    assert built == expected


def test_citation_and_the_newest_release_in_the_changelog_are_those_of_this_version():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    lines = (ROOT / "CHANGELOG.md").read_text().splitlines()
    newest = next(line for line in lines if line.startswith("## ") and line != "## [Unreleased]")
    assert cited["version"] == deqmcl_gym.__version__
    assert newest == f"## [{cited['version']}] - {cited['date-released']}"


def test_plots_and_reports_are_extras_and_not_required():
    required = PROJECT["project"]["dependencies"]
    assert not any(line.startswith(("matplotlib", "jinja2", "scipy")) for line in required)


def heed_permissions() -> None:
    """Make them hold for root, too, from the next program on."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(DROP_FROM_BOUNDING_SET, DAC_OVERRIDE, 0, 0, 0)


@pytest.fixture(scope="module")
def locked(tmp_path_factory):
    """The three packages, and a home, in folders without permission to write."""
    root = tmp_path_factory.mktemp("install")
    for package in PACKAGES:
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
    command = (sys.executable, "-W", "error", "-c", *arguments)
    how = {"cwd": locked, "env": bare | {"TMPDIR": str(temporary)}}
    done = process(*command, **how, preexec_fn=heed_permissions)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.slow
def test_the_papers_run_works_without_a_folder_for_its_kernels(locked, tmp_path):
    paper = ("paper", "--trials", "1", "--particles", "10", "--out", tmp_path / "out")
    said = run(locked, tmp_path, COMMAND, *paper, "--jobs", "2")
    assert "figures/lap.webp" in said
    assert not list(tmp_path.rglob("*.nbc"))
    assert [*locked.rglob("__pycache__"), *(locked / "home").iterdir()] == []
