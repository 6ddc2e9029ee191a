"""A bad command line or folder: one sentence on stderr, exit code 2, nothing written over."""

import os
import shutil
import sys
import tempfile
from pathlib import Path

import pytest
from deqmcl_command import exit_code, files
from sweep_command import sweep, write_small

pytestmark = pytest.mark.usefixtures("here")  # where the default of --out is, too
RUN = ("run", "--localizer", "mcl", "--out", "out")
MAP = ("new", "map", "--out", "out")

BAD = [  # arguments, and what the sentence must name
    ([], ["COMMAND"]),
    (["lst"], ["lst", "list", "paper", "run", "sweep"]),
    (["leaderboard", "a", "b"], ["leaderboard is gone: deqmcl report A B C --out DIR makes"]),
    (["paper", "--tria", "3"], ["--tria", "--trials"]),
    ([*RUN, "--localizers", "mcl"], ["--localizers", "--localizer?"]),
    (["paper", "--trials"], ["--trials"]),
    (["paper", "--trials", "1.5"], ["--trials", "1.5"]),
    ([*RUN, "--particles", 10**9], ["particles", "1000000000", "10,000,000"]),
    ([*RUN, "--set", "params.deq-mcl.particles=9"], ["unknown localizer in params 'deq-mcl'"]),
    ([*RUN, "--set", "params.mcl.particle=9"], ["did you mean 'particles'"]),
    ([*RUN, "--set", "params.particle=9"], ["'particle'", "did you mean 'particles'"]),
    ([*RUN, "--set", "lag=5", "--set", "lag=6"], ["--set gives lag twice"]),
    ([*RUN, "--set", "word.radius=3"], ["'word.radius'", "world.…"]),
    (
        [*RUN, "--param", "mcl.particles=9"],
        ["there is no --param here: write --set params.LOCALIZER.KEY"],
    ),
    (["sweep", "quick", "--particles", "9"], ["write --set params.particles=300"]),
    ([*RUN, "--log", "lap.txt.zip"], ["of a format that is not written"]),
    (["paper", "--localizers", " , "], ["no localizer", "deq-mcl"]),
    (["paper", "--localizers", "mcl,deq-mcl,mcl"], ["twice", "mcl,"]),
    (["paper", "--scenario", "papr"], ["scenario", "'papr'", "did you mean 'paper'?", "room.toml"]),
    (["run", "--out", "out"], ["--localizer"]),
    (["run", "--localizer", "mcl", "--out", ""], ["--out: it is empty"]),
    (["new", "localizer", "my_localizer"], ["must end in .py"]),
    (["new", "localizer", "no/such/folder/mine.py"], ["the folder of the new file"]),
    ([*MAP, "--door", "0.85"], ["door", "0.85"]),
    (["check", "dec-mcl"], ["did you mean 'deq-mcl'?"]),
    (["report", "."], ["holds no manifest.json", "give the folder of a sweep or replay."]),
]
FEW = ("--particles", "20", "--lag", "3")
WRITERS = {
    "sweep": ("sweep", "quick", "--jobs", "1"),
    "paper": ("paper", "--trials", "1", "--localizers", "dead-reckoning", *FEW, "--jobs", "1"),
    "run": ("run", "--localizer", "dead-reckoning", *FEW),
    "report": ("report",),
}


@pytest.mark.parametrize(
    ("arguments", "named"), BAD, ids=[" ".join(map(str, case[0])) or "nothing" for case in BAD]
)
def test_a_bad_command_line_is_refused_and_nothing_is_written(refusal, arguments, named):
    refusal(arguments, *named)
    assert os.listdir() == []


@pytest.mark.parametrize(
    ("command", "out"),
    [("paper", "file"), ("run --localizer mcl", "file/below"), ("sweep quick", "file/far/below")],
)
def test_an_output_path_that_is_a_file_is_refused_and_kept(tmp_path, refusal, command, out):
    (tmp_path / "file").write_text("precious")
    refusal([*command.split(), "--out", tmp_path / out], "output folder", str(tmp_path / out))
    assert os.listdir() == ["file"]
    assert (tmp_path / "file").read_text() == "precious"


BAD_SWEEPS = [  # what is added to the file, arguments, and what the sentence must name
    ('\n[held_out]\nvalue = "a"', (), ["small.toml", "'held_out'"]),
    ('\nbeta = "a\\u0007b"', (), ["beta", "control characters"]),
    ("", ("--with", "a\udce9.py:L"), [r"'a\udce9.py:L'", "no UTF-8"]),
    ("\nbeta = 3", (), ["'beta'", "particles"]),  # in [params]
    ("\n[[vary]]\nparams.particles = [5, 1.5]", (), ["particles", "1.5"]),
    ("", ("--margin", "5%"), ["--margin", "--until-decided"]),
    ("", ("--until-decided", "--trials", "9"), ["--trials", "--max-worlds"]),
    ("", ("--until-decided", "--shard", "1/2"), ["--shard", "--until-decided"]),
    ("\n[until_decided]\nmargins = 0.05", (), ["until_decided", "'margins'", "margin"]),
    ("", ("--shard", "4/3"), ["--shard", "'4/3'"]),
    ("\n[[vary]]\nparams.particles = [5, 1e308]", (), ["particles", "1e+308", "1e+100"]),
    ("", ("--adopt",), ["there is no --adopt here: write deqmcl verify DIR first"]),
]


@pytest.mark.parametrize(
    ("more", "arguments", "named"),
    BAD_SWEEPS,
    ids=[(case[0][:50] or str(case[1])) for case in BAD_SWEEPS],
)
def test_a_sweep_that_cannot_be_run_is_refused_at_once(tmp_path, refusal, more, arguments, named):
    write_small(tmp_path, more=more)
    refusal(["sweep", "small.toml", "--out", "out", *arguments], *named)
    assert os.listdir() == ["small.toml"]


@pytest.mark.parametrize(
    "words", ["sweep quick --out {}", "new map --out {}", "report {}", "new localizer {}.py"]
)
def test_a_name_that_no_file_can_have_is_refused(refusal, words):
    refusal(words.format("n" * 256).split(), "File name too long")
    assert os.listdir() == []


def test_a_temporary_folder_too_deep_for_sockets_is_named(file, tmp_path, monkeypatch, refusal):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / ("d" * 100)))
    refusal(["sweep", file, "--out", tmp_path / "out"], "TMPDIR", "ddd")


def test_dask_that_is_not_installed_is_said_with_the_pip_command(file, monkeypatch, refusal):
    monkeypatch.setitem(sys.modules, "distributed", None)
    refusal(["sweep", file, "--dask", "tcp://a:1"], "pip install 'deqmcl-gym[dask]'")


def test_a_working_folder_that_is_gone_is_named(file, tmp_path, monkeypatch, refusal):
    gone, out = tmp_path / "gone", tmp_path / "out"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    for command in (("list",), ("sweep", file, "--out", out)):
        refusal(command, "the current folder is gone: change to one that exists.")
    assert not out.exists()


@pytest.fixture(scope="module")
def lap(tmp_path_factory):
    out = tmp_path_factory.mktemp("lap")
    assert exit_code(*WRITERS["run"], "--out", out) == 0
    return out


@pytest.fixture
def refused(finished, refusal):
    def of(command, out):
        before = files(Path(out))
        results = [finished] if command == "report" else []
        refusal([*WRITERS[command], *results, "--out", out], str(out))
        assert files(Path(out)) == before

    return of


@pytest.mark.parametrize(
    ("command", "name"),
    [("sweep", ".notes.tmp"), ("paper", "a"), ("report", "report.txt"), ("run", "images/mine.svg")],
)
def test_a_folder_that_is_not_ours_is_refused(tmp_path, refused, command, name):
    (tmp_path / "mine" / name).parent.mkdir(parents=True)
    (tmp_path / "mine" / name).write_text("mine")
    refused(command, tmp_path / "mine")


@pytest.mark.parametrize("command", WRITERS)
def test_a_folder_of_another_command_is_refused(tmp_path, finished, lap, refused, command):
    other = finished if command == "run" else lap
    refused(command, shutil.copytree(other, tmp_path / "other"))


def test_a_lap_is_run_again_into_its_folder_beside_a_file_of_the_users(lap):
    before = files(lap)
    (lap / "notes.txt").write_text("mine")
    (lap / "error.csv").write_text("edited")
    assert exit_code(*WRITERS["run"], "--out", lap) == 0
    assert files(lap) == before | {"notes.txt": b"mine"}


@pytest.mark.skipif(os.name == "nt", reason="names there are text")
def test_a_report_is_written_into_a_folder_whose_name_is_no_text(tmp_path):
    out = os.fsdecode(os.fsencode(tmp_path) + b"/d\xe9")
    assert sweep(write_small(tmp_path, trials=1), out) == 0
    assert exit_code("report", out) == 0
    with open(os.path.join(out, "report.html"), encoding="utf-8") as file:
        assert r"/d\xe9&#39;" in file.read()
