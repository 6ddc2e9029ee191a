"""Standard streams that are closed, full or no longer read; what a user is told while waiting."""

import io
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from deqmcl_command import exit_code, process
from sweep_command import write_small

import deqmcl_gym
from benchmarks import console
from benchmarks.sweeps.running import counted

ROOT = Path(__file__).parents[2]
FULL = "/dev/full"
LOST = "deqmcl: the output cannot be written to stdout (No space left on device).\n"

linux = pytest.mark.skipif(not Path(FULL).exists(), reason="there is no full device")


def shell(redirected, *arguments, **how):
    """Run the command by a shell that redirects its streams."""
    command = ("bash", "-c", f'"$0" -m benchmarks "$@" {redirected}', sys.executable)
    return process(*command, *arguments, **how)


@linux
@pytest.mark.parametrize("arguments", [("list",), ("--help",), ("--version",), ("check", "grid")])
def test_output_that_cannot_be_written_is_a_failure_in_one_sentence(arguments):
    done = shell(f"> {FULL}", *arguments)
    assert (done.returncode, done.stderr) == (3, LOST)


def test_a_reader_that_leaves_ends_the_command_quietly():
    done = shell("| head -n 1; exit ${PIPESTATUS[0]}", "check", "dead-reckoning")
    assert (done.returncode, done.stdout, done.stderr) == (141, "ok       answers in time\n", "")


@linux
@pytest.mark.parametrize("streams", ["2> /dev/full", "<&- >&- 2>&-", ">&-"])
def test_a_sweep_runs_the_same_whatever_its_streams_are(tmp_path, streams):
    file = write_small(tmp_path, trials=1)
    done = shell(streams, "sweep", file, "--out", tmp_path / "out", "--jobs", "2")
    assert (done.returncode, done.stderr) == (0, "")
    assert len(list((tmp_path / "out" / "trials").iterdir())) == 2
    for path in (tmp_path / "out").rglob("*.json"):
        assert path.read_text().startswith("{")  # nothing that was printed got into a file
    assert shell(streams, "lst").returncode == 2


def test_the_version_has_one_home(capsys):
    assert exit_code("--version") == 0
    assert capsys.readouterr().out == f"deqmcl {deqmcl_gym.__version__}\n"
    for name in ("pyproject.toml", "CITATION.cff"):
        for version in re.findall(r"^version[:=\s]+\"?([\d.]+)", (ROOT / name).read_text(), re.M):
            assert version == deqmcl_gym.__version__, name


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
def test_only_what_takes_long_is_told(monkeypatch, stream):
    monkeypatch.setattr(console, "PATIENCE", 0.2)
    monkeypatch.setattr(sys, "stderr", stream())
    with console.doing("blinking"):
        pass
    assert sys.stderr.getvalue() == ""
    with console.doing("sleeping"):
        time.sleep(0.5)
    said = sys.stderr.getvalue()
    if stream is Terminal:
        first, blank, end = said.split("\r")[1:]
        assert (first, blank, end) == ("sleeping … 0 s", " " * len(first), "")
    else:
        assert said == "deqmcl: sleeping …\n"


def test_the_bar_names_the_sweep_and_counts_failures(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with counted(tmp_path / "quick", 4, 3) as count:
        count(False)
        count(True)
        count(True)
    first, *_, last = sys.stderr.getvalue().strip().split("\r")
    assert first.startswith("quick:  25%")
    assert "failed" not in first
    assert "2 failed" in last


@pytest.mark.slow
def test_the_first_compilation_is_told_and_nothing_of_it_is_output(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "check", "dead-reckoning"],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "deqmcl: loading dead-reckoning …\n" in done.stderr
    assert "…" not in done.stdout
