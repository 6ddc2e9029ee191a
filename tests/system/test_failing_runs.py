"""A run that fails: exit code 3, one line, and what was finished is kept."""

import json

import pytest
from deqmcl_command import exit_code, files, python

from localizers.naming import registry

FULL_DISK = """
import resource, signal, sys
from benchmarks.cli import main
from benchmarks.pictures import figures
from benchmarks.report import writing
figures.write_figures = lambda *_: []
writing.no_report = lambda: "not here"
out, quota = sys.argv[1], int(sys.argv[2])
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
def run(trials):
    few = ["--localizers", "mcl,dead-reckoning", "--particles", "10", "--jobs", "1"]
    return main(["paper", "--trials", str(trials), *few, "--out", out])
unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
codes = [run(1)]
resource.setrlimit(resource.RLIMIT_FSIZE, (quota, unlimited))
codes.append(run(3))
resource.setrlimit(resource.RLIMIT_FSIZE, (unlimited, unlimited))
import pathlib, shutil
shutil.copytree(out, out + "-full")
codes.append(run(3))
print("codes:", *codes)
"""


@pytest.fixture(scope="module")
def full_disk(tmp_path_factory):
    """One trial each; then three each where no file may be longer than 1000 bytes; then again."""
    out = tmp_path_factory.mktemp("disk") / "out"
    return python(FULL_DISK, out, 1000), out


def test_a_disk_that_is_full_is_said_in_one_line_naming_the_file(full_disk):
    done, out = full_disk
    assert done.stdout.splitlines()[-1] == "codes: 0 3 0", done.stderr
    assert done.stderr.startswith(f"deqmcl: File too large: {out}/")
    assert done.stderr.count("\n") == 1


def test_a_full_disk_leaves_earlier_files_intact_and_nothing_half_written(full_disk):
    _, out = full_disk
    after = files(out.with_name("out-full"))
    trials = [name for name in after if name.startswith("trials/")]
    assert len(trials) == 2
    for name in trials:
        assert json.loads(after[name])["steps_done"] == 204
        assert after[name] == files(out)[name]
    assert not [name for name in after if "tmp" in name]
    assert after["table.md"].startswith(b"# Table 1, scenario paper: 1 world")


def test_once_there_is_room_again_the_run_goes_on_and_ends_as_if_nothing_had_been(
    full_disk, tmp_path
):
    _, out = full_disk
    few = ("--localizers", "mcl,dead-reckoning", "--particles", "10", "--jobs", "1")
    assert exit_code("paper", "--trials", "3", *few, "--out", tmp_path) == 0
    for name in ("results.csv", "trials.csv", "table.md"):
        assert files(out)[name] == files(tmp_path)[name]


def broken(robot):
    raise ArithmeticError("broken\nfrom the start")


def test_a_failing_localizer_fails_the_run_in_one_line_and_the_others_trials_are_kept(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(registry._FACTORIES, "broken", broken)
    few = ("--trials", "2", "--localizers", "broken,dead-reckoning", "--jobs", "1")
    assert exit_code("paper", *few, "--out", tmp_path) == 3
    printed = capsys.readouterr()
    assert printed.out.startswith("The paper's experiment: 2 of 4 trials finished, 2 failed.\n")
    assert printed.err == (
        "deqmcl: 2 of 4 trials failed, the rest is kept; first: broken, trial 0: ArithmeticError: "
        "broken from the start (--debug shows where)\n"
    )
    assert len([name for name in files(tmp_path) if name.startswith("trials/")]) == 2
    assert not (tmp_path / "table.md").exists()  # no Table 1 of half an experiment


def test_a_localizer_that_refuses_its_parameters_is_bad_input_and_nothing_is_written(
    tmp_path, monkeypatch, capsys
):
    def picky(robot, *, particles):
        from deqmcl_gym.validation import integer

        integer("particles", particles, low=50)

    monkeypatch.setitem(registry._FACTORIES, "picky", picky)
    few = ("--trials", "2", "--localizers", "dead-reckoning,picky", "--jobs", "1")
    assert exit_code("paper", *few, "--particles", 49, "--out", tmp_path / "out") == 2
    assert capsys.readouterr().err == (
        "deqmcl: particles is 49, but must be a whole number of 50 or more.\n"
    )
    assert list(tmp_path.iterdir()) == []
