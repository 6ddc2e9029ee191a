"""A bad command line: one sentence on stderr, exit code 2, nothing written."""

import sys

import pytest
from deqmcl_command import exit_code

RUN = ("run", "--localizer", "mcl", "--out", "out")
PHASE = ("phase", "--out", "out")

BAD = [  # arguments, and what the sentence must name
    ([], ["COMMAND"]),
    (["lst"], ["lst", "list", "paper", "run", "sweep"]),
    (["paper", "--trails=3"], ["--trails", "--trials"]),
    (["paper", "--tria", "3"], ["--tria", "--trials"]),
    ([*RUN, "--localizers", "mcl"], ["--localizers", "--localizer?"]),
    (["--trials", "3", "paper"], ["3"]),
    (["paper", "now"], ["now"]),
    (["paper", "--trials"], ["--trials"]),
    (["paper", "--trials", "1.5"], ["--trials", "1.5"]),
    (["paper", "--trials", "100001"], ["--trials", "100001"]),
    (["paper", "--particles", "0"], ["--particles", "0"]),
    (["paper", "--jobs", "0"], ["--jobs", "0"]),
    (["paper", "--lag", "-1"], ["--lag", "-1"]),
    (["paper", "--seed", "-1"], ["--seed", "-1"]),
    ([*RUN, "--particles", 10**9], ["particles", "1,000,000,000", "GiB", "10,000,000"]),
    ([*PHASE, "--fields", "1"], ["--fields", "1"]),
    ([*PHASE, "--localizers", "mcl,dec-mcl"], ["'dec-mcl'", "did you mean 'deq-mcl'?"]),
    (["paper", "--localizers", " , "], ["no localizer", "deq-mcl"]),
    (["paper", "--localizers", "mcl,deq-mcl,mcl"], ["twice", "mcl,"]),
    (["paper", "--scenario", "papr"], ["scenario", "'papr'", "did you mean 'paper'?", "room.toml"]),
    (["run", "--localizer", "mcl"], ["--out"]),
    (["run", "--out", "out"], ["--localizer"]),
]


def assert_one_sentence(err, named):
    assert err.startswith("deqmcl")
    assert err.endswith(".\n")
    assert err.count("\n") == 1
    for usage in ("Traceback", "usage:", "Error:"):
        assert usage not in err
    for words in named:
        assert words in err


@pytest.mark.parametrize(
    ("arguments", "named"), BAD, ids=[" ".join(map(str, case[0])) or "nothing" for case in BAD]
)
def test_a_bad_command_line_is_refused_in_one_sentence_and_nothing_is_written(
    tmp_path, monkeypatch, capsys, arguments, named
):
    monkeypatch.chdir(tmp_path)  # so is the default of --out
    assert exit_code(*arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert_one_sentence(printed.err, named)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "command", ["paper", "run --localizer mcl", "phase", "sweep quick", "speed"]
)
@pytest.mark.parametrize("out", ["file", "file/below", "file/far/below"])
def test_an_output_path_that_is_a_file_is_refused_and_the_file_kept(tmp_path, capsys, command, out):
    (tmp_path / "file").write_text("precious")
    assert exit_code(*command.split(), "--out", tmp_path / out) == 2
    assert_one_sentence(capsys.readouterr().err, ["output folder", str(tmp_path / out), "file"])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "precious"


@pytest.mark.parametrize("command", [("run", "--localizer", "dead-reckoning"), ("phase",)])
def test_what_draws_names_the_pip_command_without_matplotlib(
    tmp_path, monkeypatch, capsys, command
):
    loaded = [name for name in sys.modules if name.startswith("matplotlib.")]
    for name in ("matplotlib", *loaded):
        monkeypatch.setitem(sys.modules, name, None)
    assert exit_code(*command, "--out", tmp_path / "out") == 2
    assert_one_sentence(capsys.readouterr().err, ["pip install 'deqmcl-gym[plots]'"])
    assert list(tmp_path.iterdir()) == []
