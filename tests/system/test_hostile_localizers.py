"""Whatever a plug-in does to its process: a command ends, says so, keeps what others did."""

import contextlib
import itertools
import re
import sys
import time
from pathlib import Path

import pytest
from deqmcl_command import exit_code, lines
from sweep_command import sweep, write_small

from benchmarks.execution import processes
from benchmarks.execution.apart import answered_within

HOSTILE = Path(__file__).with_name("hostile.py").read_text()
NAME = "./hostile.py:Hostile"
FATAL = ("hang", "exit", "end", "interrupt", "close", "recurse", "allocate")
HARMLESS = ("leave", "spoil", "thread", "fork", "child", "daemon")

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, in which the plug-in lies."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write_hostile(folder, what, when):
    told = f"WHAT, WHEN, STARTED = {what!r}, {when!r}, {str(folder / 'started')!r}"
    first = 'WHAT, WHEN, STARTED = "nothing", "never", ""'
    assert first in HOSTILE
    (folder / "hostile.py").write_text(HOSTILE.replace(first, told))


def small_sweep(folder, out, timeout=60):
    return sweep(write_small(folder, trials=1, others=[NAME]), out, "--timeout", timeout)


def trials_in(folder):
    """The table of trials, without the path of the plug-in."""
    return (folder / "out" / "trials.csv").read_text().replace(str(folder), "")


def gone(number):
    command = Path(f"/proc/{number}/cmdline")
    return not command.exists() or not command.read_bytes()


@pytest.mark.parametrize("what", FATAL)
def test_a_plug_in_that_would_end_or_hang_the_command_fails_its_own_trials(folder, capfd, what):
    when = ("import", "make", "reset", "update", "points")[FATAL.index(what) % 5]
    write_hostile(folder, what, when)
    assert small_sweep(folder, Path("out"), 2 if what == "hang" else 60) == 3
    said = capfd.readouterr().err
    kept = "deqmcl: 1 of 3 trials failed, the rest is kept; first:"
    assert said.startswith(f"{kept} hostile.py:Hostile, trial 0: ")
    assert "Traceback" not in said
    assert {line["method"] for line in lines(folder / "out")} == {"mcl", "dead-reckoning"}


@pytest.fixture(scope="module")
def unspoilt(tmp_path_factory):
    """The trials table of the same localizer when it does nothing."""
    folder = tmp_path_factory.mktemp("unspoilt")
    write_hostile(folder, "nothing", "never")
    with contextlib.chdir(folder):
        assert small_sweep(folder, folder / "out") == 0
    return trials_in(folder)


@pytest.mark.parametrize("what", HARMLESS)
def test_what_a_plug_in_does_to_its_process_changes_no_result_and_ends_with_it(
    folder, unspoilt, what
):
    write_hostile(folder, what, "make")
    assert small_sweep(folder, Path("out")) == 0
    assert trials_in(folder) == unspoilt
    started = folder / "started"
    numbers = started.read_text().split() if started.exists() else []
    assert bool(numbers) == (what in ("child", "daemon"))
    until = time.monotonic() + 5
    while not all(map(gone, numbers)) and time.monotonic() < until:
        time.sleep(0.02)
    assert all(map(gone, numbers))


@pytest.mark.parametrize("command", ["run", "check", "sweep"])
def test_no_command_ends_with_exit_code_0_because_a_plug_in_does(folder, capfd, command):
    write_hostile(folder, "end", "update")
    given = {
        "run": ("--localizer", NAME, "--out", "out"),
        "check": (NAME,),
        "sweep": (write_small(folder, trials=1), "--with", NAME, "--dry-run", "--out", "out"),
    }
    code = exit_code(command, *given[command])
    said = capfd.readouterr()
    if command == "sweep":
        assert "failed" in said.out  # the cell of this one
    else:
        assert code == 3
        assert said.err.startswith("deqmcl: ")
    assert "Traceback" not in said.err
    assert not list((folder / "out").glob("*.csv"))


def write_setup(folder, what, when):
    """Write a scenario and an agent that do WHAT it is told, and TOML files that lead to both."""
    write_hostile(folder, what, when)
    hostile = (folder / "hostile.py").read_text()
    agent = (
        "class Driver:\n"
        "    def __init__(self, robot):\n        at('make')\n"
        "    def plan_at_reset(self, info):\n        return None\n"
        "    def act(self, belief, info):\n        at('act')\n"
        "        return info['planned_actions'][0], None\n"
    )
    (folder / "agent.py").write_text(f"{hostile}\n{agent}")
    made = "from benchmarks.setup.names import scenario\nMINE = scenario('paper')\n"
    (folder / "room.py").write_text(f"{hostile}\n{made}")
    (folder / "agent.toml").write_text('agent = "agent.py:Driver"')
    (folder / "base.toml").write_text('base = "room.py:MINE"')


SETUPS = {"import": ("room.py:MINE", "base.toml", "agent.toml"), "make": ("agent.toml",)}
SETUPS["act"] = SETUPS["make"]
COMMANDS = {
    "run": ("--localizer", "mcl", "--particles", "10"),
    "paper": ("--localizers", "mcl", "--trials", "1", "--particles", "10"),
    "sweep": (),  # what is in the file
}
# each way to end or hang at each moment; scenarios and commands take turns
TROUBLES = [
    (what, when, SETUPS[when][number % len(SETUPS[when])], [*COMMANDS][number % 3])
    for number, (when, what) in enumerate(itertools.product(SETUPS, FATAL))
]


@pytest.mark.parametrize(("what", "when", "scenario", "command"), TROUBLES)
def test_no_scenario_or_agent_ends_or_hangs_a_command(
    folder, capfd, monkeypatch, what, when, scenario, command
):
    monkeypatch.setattr(processes, "PATIENCE", 2.0)
    write_setup(folder, what, when)
    file = folder / "small.toml"
    file.write_text(f'scenario = "{scenario}"\nlocalizers = ["mcl"]\ntrials = 1')
    own = (file, "--timeout", "2", "--dry-run")
    given = own if command == "sweep" else (*COMMANDS[command], "--scenario", scenario)
    with answered_within(2):
        code = exit_code(command, *given, "--out", "out")
    said = capfd.readouterr()
    assert "Traceback" not in said.err
    if when == "act" and command == "sweep":
        assert "failed" in said.out
    else:
        assert code == (3 if when == "act" else 2)
        assert re.sub(r"deqmcl: .* …\n", "", said.err).startswith("deqmcl: ")
        assert when == "act" or not (folder / "out").exists()
