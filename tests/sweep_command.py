"""Small sweeps by ``deqmcl sweep``."""

import json
from contextlib import contextmanager
from pathlib import Path

import pytest
from deqmcl_command import exit_code

from benchmarks.report import page
from localizers.template import MyLocalizer

SMALL = """
title = "small"
localizers = {localizers}
trials = {trials}
lag = 4

[params]
particles = {particles}
"""
TABLES = ("results.csv", "trials.csv")


@contextmanager
def without_report():
    """Commands of this process write the tables only."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(page, "no_report", lambda: "it is left out")
        yield patched


def write_small(folder, trials=2, particles=15, more="", others=()):
    path = folder / "small.toml"
    named = json.dumps(["mcl", "dead-reckoning", *others])
    path.write_text(SMALL.format(trials=trials, particles=particles, localizers=named) + more)
    return path


def write_hostile(folder, what, when):
    """Write the plug-in that does so at that moment; return its name."""
    text = Path(__file__).with_name("hostile.py").read_text()
    told = f"WHAT, WHEN, STARTED = {what!r}, {when!r}, {str(folder / 'started')!r}"
    first = 'WHAT, WHEN, STARTED = "nothing", "never", ""'
    assert first in text
    (folder / "hostile.py").write_text(text.replace(first, told))
    return f"{folder}/hostile.py:Hostile"


def sweep(file, out, *more):
    """Run the command in this process, on one job unless told otherwise; return its exit code.

    It draws no report, which would take longer than the trials.
    """
    with without_report():
        return exit_code("sweep", file, "--out", out, "--jobs", "1", *more)


def report(out, *more):
    with without_report() as patched:
        patched.setattr(page, "require_report", lambda: None)
        return exit_code("report", out, *more)


def tables(out):
    return {name: (out / name).read_bytes() for name in TABLES}


class broken(MyLocalizer):  # noqa: N801
    def __init__(self, robot, **params):
        pass

    def reset(self, prior, plan, rng):
        raise ArithmeticError("broken")
