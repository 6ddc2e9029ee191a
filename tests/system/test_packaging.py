"""The wheel: the three packages without what only a clone needs, typed, with the command."""

import shutil
import tomllib
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
import yaml
from deqmcl_command import python

import deqmcl_gym

ROOT = Path(__file__).parents[2]
PACKAGES = ("benchmarks", "deqmcl_gym", "localizers")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def folders():
    """Folders with Python files below the root, as dotted names; hidden and built ones left out."""
    for path in ROOT.rglob("*.py"):
        parts = path.relative_to(ROOT).parent.parts
        if parts and not any(part.startswith(".") or part in ("build", "dist") for part in parts):
            yield ".".join(parts)


def test_the_patterns_of_pyproject_choose_exactly_the_three_packages():
    patterns = PROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    chosen = {name for name in folders() if any(fnmatchcase(name, p) for p in patterns)}
    assert {name.partition(".")[0] for name in chosen} == set(PACKAGES)
    assert {name for name in folders() if name.partition(".")[0] in PACKAGES} == chosen


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
