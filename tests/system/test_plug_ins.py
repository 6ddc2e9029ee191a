"""Whatever a plug-in does: in its trials it costs these alone; before, the command says so."""

import contextlib
import sys
import time
from pathlib import Path

import pytest
from deqmcl_command import exit_code, lines
from sweep_command import sweep, write_hostile, write_small

NAME = "./hostile.py:Hostile"
FATAL = [
    ("hang", "update", "no result within 4 s: its worker (process "),
    ("end", "reset", "lost 3 times by its worker; last: WorkerDiedError: its worker died"),
    ("exit", "points", "SystemExit: 0"),
    ("interrupt", "update", "KeyboardInterrupt"),
]
HARMLESS = ("leave", "spoil", "child")

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")


def small_sweep(folder, out, timeout=60):
    return sweep(write_small(folder, trials=1, others=[NAME]), out, "--timeout", timeout)


def trials_in(folder):
    return (folder / "out" / "trials.csv").read_text().replace(str(folder), "")


@pytest.mark.parametrize(("what", "when", "why"), FATAL)
def test_a_plug_in_that_ends_or_hangs_fails_its_own_trials(here, capfd, what, when, why):
    write_hostile(here, what, when)
    assert small_sweep(here, Path("out"), 4 if what == "hang" else 60) == 3
    said = capfd.readouterr().err
    kept = "deqmcl: 1 of 3 trials failed, the rest is kept; first:"
    assert said.startswith(f"{kept} hostile.py:Hostile, trial 0: {why}")
    assert "Traceback" not in said
    assert {line["method"] for line in lines(here / "out")} == {"mcl", "dead-reckoning"}


@pytest.fixture(scope="module")
def unspoilt(tmp_path_factory):
    """The trials table of the same localizer when it does nothing."""
    folder = tmp_path_factory.mktemp("unspoilt")
    write_hostile(folder, "nothing", "never")
    with contextlib.chdir(folder):
        assert small_sweep(folder, folder / "out") == 0
    return trials_in(folder)


@pytest.mark.parametrize("what", HARMLESS)
def test_what_a_plug_in_does_to_its_process_changes_no_result(here, unspoilt, what):
    write_hostile(here, what, "reset")
    assert small_sweep(here, Path("out")) == 0
    assert trials_in(here) == unspoilt
    if what == "child":
        command = Path(f"/proc/{(here / 'started').read_text().strip()}/cmdline")
        until = time.monotonic() + 5
        while command.exists() and command.read_bytes() and time.monotonic() < until:
            time.sleep(0.02)
        assert not command.exists() or not command.read_bytes()


def write_setup(folder):
    hostile = (folder / "hostile.py").read_text()
    (folder / "agent.py").write_text(f"{hostile}\nclass Driver: ...\n")
    (folder / "agent.toml").write_text('agent = "agent.py:Driver"')


@pytest.mark.parametrize(
    ("what", "when", "command"),
    [
        ("recurse", "make", ("sweep", "small.toml")),
        ("close", "import", ("run", "--localizer", "mcl", "--scenario", "agent.toml")),
        ("exit", "import", ("paper", "--scenario", "agent.toml", "--trials", "1")),
    ],
)
def test_what_ends_its_import_or_making_is_refused(here, refusal, what, when, command):
    write_hostile(here, what, when)
    write_small(here, trials=1, others=[NAME])
    write_setup(here)
    said = refusal([*command, "--out", "out"], "its own code raised")
    assert ".py, line " in said
    assert not (here / "out").exists()


def test_a_lap_that_a_plug_in_ends_has_not_succeeded(here, capfd):
    write_hostile(here, "exit", "update")
    assert exit_code("run", "--localizer", NAME, "--out", "out") == 3
    assert "Traceback" not in capfd.readouterr().err
