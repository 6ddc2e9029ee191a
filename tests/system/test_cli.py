"""What the ``deqmcl`` command promises beside its results: help, exit codes, streams."""

import os
import re
import sys
from pathlib import Path

import pytest
from deqmcl_command import DEQMCL, exit_code, process, python, records
from sweep_command import write_small

import deqmcl_gym
import localizers
from benchmarks.agents import AGENTS
from benchmarks.commands import COMMANDS, experiments
from benchmarks.setup.names import SCENARIOS, scenario
from benchmarks.sweeps.sweepfile import SUITES

HELP = [("--help",), *((name, "--help") for name in COMMANDS)]
OURS = "benchmarks", "localizers", "deqmcl_gym"
COMMON = "numpy", "random", "signal", "queue", "socket", "yaml"
LOST = "deqmcl: the output cannot be written to stdout (No space left on device).\n"

linux = pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")


def test_help_is_no_error_and_loads_nothing_heavy():
    code = (
        "import sys\n"
        "from benchmarks.cli import main\n"
        f"for words in {HELP}:\n"
        "    try:\n        main(list(words))\n"
        "    except SystemExit as end:\n        assert end.code == 0\n"
        "heavy = {'numpy', 'numba', 'cv2', 'pymunk', 'matplotlib', 'gymnasium', 'scipy'}\n"
        "print('loaded:', sorted(heavy & set(sys.modules)))\n"
    )
    said = python("-c", code)
    assert said.count("usage: deqmcl") == len(HELP)
    assert said.endswith("\nloaded: []\n")


def test_a_terminal_without_greek_letters_is_no_reason_to_fail():
    code = (
        "from benchmarks import cli; from benchmarks.commands import experiments as of\n"
        "of.run_command = of.run_command._replace(run=lambda *_: 'cos θ')\n"
        "raise SystemExit(cli.main())"
    )
    arguments = ("run", "--localizer", "mcl", "--out", "out")
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    assert python("-c", code, *arguments, env=ascii_only) == "cos ?\n"


def test_python_m_benchmarks_refuses_as_the_main_function_does(tmp_path, capsys):
    wrong = ("paper", "--trails", "3")
    expected = (exit_code(*wrong), *capsys.readouterr())
    done = process(sys.executable, "-m", "benchmarks", *wrong, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == expected


def test_no_env_needs_benchmarks_and_what_hides_localizers_is_named(tmp_path):
    code = "import gymnasium as gym, deqmcl_gym\nprint(gym.make('deqmcl_gym/Track-v0'))"
    (tmp_path / "train.py").write_text(code)
    for name in ("benchmarks", "localizers"):
        (tmp_path / f"{name}.py").touch()
        done = process(sys.executable, tmp_path / "train.py", cwd=tmp_path)
        if name == "benchmarks":
            assert "Track<deqmcl_gym/Track-v0>" in done.stdout, done.stderr
    refusal = done.stderr.splitlines()[-1]
    assert "Track needs deqmcl-gym's package localizers, but " in refusal
    assert str(tmp_path / "localizers") in refusal


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (RuntimeError("on two\n  lines"), 3, "deqmcl: on two lines (--debug shows where)\n"),
        (NotImplementedError(), 3, "deqmcl: NotImplementedError (--debug shows where)\n"),
        (KeyError("offset"), 3, "deqmcl: KeyError: 'offset' (--debug shows where)\n"),
        (OSError(28, "No space left", "a/b"), 3, "deqmcl: No space left: a/b.\n"),
        (KeyboardInterrupt(), 130, "deqmcl: interrupted; finished trials are kept.\n"),
    ],
)
def test_a_failing_run_says_why_and_with_debug_where(capsys, monkeypatch, here, error, code, said):
    def fail(*_, **__):
        raise error

    failing = experiments.paper_command._replace(run=fail)
    monkeypatch.setattr(experiments, "paper_command", failing)
    assert exit_code("paper", "--out", here) == code
    assert capsys.readouterr() == ("", said)
    if code == 3 and not isinstance(error, OSError):
        with pytest.raises(type(error)) as caught:
            exit_code("paper", "--debug", "--out", here)
        assert caught.value is error


def test_the_list_shows_all_kinds_even_if_one_cannot_be_loaded(monkeypatch, capsys):
    broken = (*localizers.names(), "no_such_module:Theirs")
    monkeypatch.setattr(localizers, "names", lambda: broken)
    assert exit_code("list", "--all") == 0
    said = capsys.readouterr().out
    for words in (*SUITES, *localizers.names(), *SCENARIOS, *AGENTS):
        assert re.search(rf"^  {words}\b", said, re.MULTILINE)
    for name in SCENARIOS:
        assert re.search(rf"^  {name} +{re.escape(scenario(name).words)}$", said, re.MULTILINE)
    assert re.search(r"^  no_such_module:Theirs +cannot be loaded: the localizer", said, re.M)


def test_the_list_shows_six_of_each_and_all_of_the_kind_that_is_named(capsys):
    assert exit_code("list") == 0
    blocks = capsys.readouterr().out.strip().split("\n\n")
    assert [len(block.splitlines()) for block in blocks] == [8] * 4  # a title, six, and the rest
    assert exit_code("list", "suites") == 0
    said = capsys.readouterr().out
    assert len(said.splitlines()) == 1 + len(SUITES)
    assert re.search(r"^  lost +1,100 trials on 100 worlds: ", said, re.MULTILINE)


def test_tab_completes_options_of_a_command(tmp_path):
    told, line = tmp_path / "offered", "deqmcl new map --co"
    shell = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": str(told)}
    shell |= {"_ARGCOMPLETE_IFS": "|", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    process(DEQMCL, env=os.environ | shell)
    offered = {word.strip() for word in told.read_text().split("|")}
    assert offered == {"--corridor", "--corridors"}


def shell(redirected, *arguments, **how):
    return process("bash", "-c", f'"$0" "$@" {redirected}', DEQMCL, *arguments, **how)


@linux
def test_output_that_cannot_be_written_is_a_failure_in_one_sentence():
    done = shell("> /dev/full", "--help")
    assert (done.returncode, done.stderr) == (3, LOST)


def test_a_reader_that_leaves_ends_the_command_quietly():
    done = shell("| head -n 1; exit ${PIPESTATUS[0]}", "check", "dead-reckoning")
    assert (done.returncode, done.stdout, done.stderr) == (141, "ok       answers in time\n", "")


def test_a_sweep_and_its_workers_need_no_streams_and_no_name_in_the_working_folder(here):
    for name in OURS:
        (here / name).mkdir()
        (here / name / "__init__.py").touch()
    for name in COMMON:
        (here / f"{name}.py").write_text("raise SystemExit(f'{__file__} is imported')")
    file, streams = write_small(here, trials=1), "<&- >&- 2>&-"
    done = shell(streams, "sweep", file, "--out", "out", "--jobs", "2")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert len(records(here / "out")) == 2
    for path in (here / "out").rglob("*.json*"):
        assert path.read_text().startswith("{")  # nothing that was printed got into a file


def test_the_version_is_that_of_the_package(capsys):
    assert exit_code("--version") == 0
    assert capsys.readouterr().out == f"deqmcl {deqmcl_gym.__version__}\n"
