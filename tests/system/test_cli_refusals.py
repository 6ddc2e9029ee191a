"""A bad command line: one sentence on stderr, exit code 2, nothing written."""

import sys

import pytest
from deqmcl_command import DEQMCL, exit_code, process

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
    *[(["paper", "--trials", value], ["--trials", value]) for value in ("0", "x", "1.5", "")],
    *[
        (["paper", flag, value], [flag, value])
        for flag, value in (
            *(("--trials", "100001"), ("--particles", "0"), ("--jobs", "0")),
            *(("--lag", "-1"), ("--seed", "-1")),
        )
    ],
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
    "command", [("paper",), ("run", "--localizer", "mcl"), ("phase",), ("sweep", "quick")]
)
@pytest.mark.parametrize("out", ["file", "file/below", "file/far/below"])
def test_an_output_path_that_is_a_file_is_refused_and_the_file_kept(tmp_path, capsys, command, out):
    (tmp_path / "file").write_text("precious")
    assert exit_code(*command, "--out", tmp_path / out) == 2
    assert_one_sentence(capsys.readouterr().err, ["output folder", str(tmp_path / out), "file"])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "precious"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["paper", "--trails", "3"], ["--trails", "--trials"]),
        (["paper", "--localizers", "dec-mcl"], ["did you mean 'deq-mcl'?"]),
    ],
)
def test_the_process_refuses_as_its_main_function_does(tmp_path, arguments, named):
    done = process(DEQMCL, *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert_one_sentence(done.stderr, named)
    assert list(tmp_path.iterdir()) == []


class Without:
    """A finder of modules that does not find matplotlib."""

    def __init__(self, finder):
        self._finder = finder

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "matplotlib":
            return None
        return self._finder.find_spec(name, path, target)

    def __getattr__(self, name):
        return getattr(self._finder, name)


@pytest.mark.parametrize("command", [("run", "--localizer", "dead-reckoning"), ("phase",)])
def test_what_draws_names_the_pip_command_without_matplotlib(
    tmp_path, monkeypatch, capsys, command
):
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Without(finder) for finder in sys.meta_path])
    assert exit_code(*command, "--out", tmp_path / "out") == 2
    assert_one_sentence(capsys.readouterr().err, ["pip install 'deqmcl-gym[plots]'"])
    assert list(tmp_path.iterdir()) == []
