"""What the ``deqmcl`` command promises beside its results: help, speed of help, exit codes."""

import os
import re
import sys

import pytest
from deqmcl_command import DEQMCL, exit_code, process, python

import localizers
from benchmarks.cli import main
from benchmarks.commands import COMMANDS, paper
from benchmarks.setup.names import agent_names, scenario, scenario_names
from benchmarks.sweeps.suites import SUITES

HELP = [("--help",), *((name, "--help") for name in COMMANDS)]


def test_help_is_no_error_and_loads_nothing_heavy():
    code = (
        "import sys\n"
        "from benchmarks.cli import main\n"
        "try:\n    main(sys.argv[1:])\n"
        "except SystemExit as end:\n    assert end.code == 0\n"
        "heavy = {'numpy', 'numba', 'cv2', 'pymunk', 'matplotlib', 'gymnasium', 'scipy'}\n"
        "print('loaded:', sorted(heavy & set(sys.modules)))\n"
    )
    for arguments in HELP:
        done = python(code, *arguments)
        assert done.stdout.startswith("usage: deqmcl")
        assert (done.stdout.splitlines()[-1], done.stderr) == ("loaded: []", "")


def test_a_terminal_without_greek_letters_is_no_reason_to_fail():
    code = (
        "from benchmarks import cli; from benchmarks.commands import run\n"
        "run.run = lambda *_: 'cos θ'; raise SystemExit(cli.main())"
    )
    arguments = ("run", "--localizer", "mcl", "--out", "out")
    done = python(code, *arguments, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stdout) == (0, "cos ?\n"), done.stderr


def test_deqmcl_and_python_m_benchmarks_refuse_as_the_main_function_does(tmp_path, capsys):
    wrong = ("paper", "--trails", "3")
    expected = (exit_code(*wrong), *capsys.readouterr())
    for command in ((DEQMCL,), (sys.executable, "-m", "benchmarks")):
        done = process(*command, *wrong, cwd=tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == expected


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (RuntimeError("it went wrong"), 3, "deqmcl: it went wrong (--debug shows where)\n"),
        (RuntimeError("on two\n  lines"), 3, "deqmcl: on two lines (--debug shows where)\n"),
        (NotImplementedError(), 3, "deqmcl: NotImplementedError (--debug shows where)\n"),
        (RuntimeError(), 3, "deqmcl: RuntimeError (--debug shows where)\n"),
        (KeyError("offset"), 3, "deqmcl: KeyError: 'offset' (--debug shows where)\n"),
        (OSError(28, "No space left", "a/b"), 3, "deqmcl: No space left: a/b.\n"),
        (KeyboardInterrupt(), 130, "deqmcl: interrupted; finished trials are kept.\n"),
    ],
)
def test_a_run_that_fails_says_why_on_one_line(capsys, monkeypatch, tmp_path, error, code, said):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(paper, "run", fail)
    assert main(["paper", "--out", str(tmp_path)]) == code
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == ("", said)


def test_debug_shows_where_a_run_failed(monkeypatch, tmp_path):
    def fail(*_, **__):
        raise RuntimeError("it went wrong")

    monkeypatch.setattr(paper, "run", fail)
    with pytest.raises(RuntimeError, match="it went wrong"):
        main(["paper", "--debug", "--out", str(tmp_path)])


def test_the_list_shows_suites_localizers_scenarios_and_agents_even_if_one_cannot_be_loaded(
    monkeypatch, capsys
):
    broken = (*localizers.names(), "no_such_module:Theirs")
    monkeypatch.setattr(localizers, "names", lambda: broken)
    assert exit_code("list") == 0
    said = capsys.readouterr().out
    for words in (*SUITES, *localizers.names(), *scenario_names(), *agent_names()):
        assert re.search(rf"^  {words}\b", said, re.MULTILINE)
    for name in scenario_names():
        assert re.search(rf"^  {name} +{re.escape(scenario(name).words)}$", said, re.MULTILINE)
    assert re.search(r"^  no_such_module:Theirs +cannot be loaded: the localizer", said, re.M)
    assert re.search(r"^  headline +10,800 trials: ", said, re.MULTILINE)
