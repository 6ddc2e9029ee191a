"""Where a command writes: into folders of its own, and over nothing that is somebody else's."""

import os
import shutil
from pathlib import Path

import pytest
from deqmcl_command import exit_code, files
from sweep_command import sweep, write_small

FEW = ("--particles", "20", "--lag", "3")
WRITERS = {
    "sweep": ("sweep", "quick", "--jobs", "1"),
    "paper": ("paper", "--trials", "1", "--localizers", "dead-reckoning", *FEW, "--jobs", "1"),
    "run": ("run", "--localizer", "dead-reckoning", *FEW),
    "phase": ("phase", "--localizers", "dead-reckoning", *FEW),
    "speed": ("speed", "--quick"),
    "report": ("report",),
}


@pytest.fixture(scope="module")
def lap(tmp_path_factory):
    """The folder of ``deqmcl run``."""
    out = tmp_path_factory.mktemp("lap")
    assert exit_code(*WRITERS["run"], "--out", out) == 0
    return out


def refused(capsys, finished, command, out):
    """What is said of an output folder that is refused, in one sentence; nothing is written."""
    given = [*WRITERS[command], *([finished] if command == "report" else [])]
    before = files(Path(out))
    capsys.readouterr()
    assert exit_code(*given, "--out", out) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert files(Path(out)) == before
    return said.err


@pytest.mark.parametrize("name", [".notes.tmp", "results.md", "images/mine.svg"])
@pytest.mark.parametrize("command", WRITERS)
def test_a_folder_that_is_not_ours_is_refused(tmp_path, finished, capsys, command, name):
    (tmp_path / "mine" / name).parent.mkdir(parents=True)
    (tmp_path / "mine" / name).write_text("mine")
    assert str(tmp_path / "mine") in refused(capsys, finished, command, tmp_path / "mine")


@pytest.mark.parametrize("command", WRITERS)
def test_a_folder_of_another_command_is_refused(
    tmp_path, finished, lap, small_run, capsys, command
):
    others = {finished, lap, small_run[1]} - ({lap} if command == "run" else set())
    for other in others:
        shutil.copytree(other, out := tmp_path / str(len(list(tmp_path.iterdir()))))
        assert str(out) in refused(capsys, finished, command, out)


@pytest.mark.parametrize("command", [*WRITERS, "folder"])
def test_an_empty_name_is_not_the_current_folder(tmp_path, monkeypatch, capsys, finished, command):
    monkeypatch.chdir(tmp_path)
    if command == "folder":
        assert exit_code("report", "") == 2
    else:
        refused(capsys, finished, command, "")
    assert os.listdir() == []


def test_a_lap_is_run_again_into_its_folder_beside_a_file_of_the_users(lap, capsys):
    before = files(lap)
    (lap / "notes.txt").write_text("mine")
    assert exit_code(*WRITERS["run"], "--out", lap) == 0
    assert files(lap) == before | {"notes.txt": b"mine"}
    (lap / "error.csv").write_text("edited")
    capsys.readouterr()
    assert exit_code(*WRITERS["run"], "--out", lap) == 2
    assert "error.csv is not as deqmcl wrote it" in capsys.readouterr().err
    assert (lap / "error.csv").read_text() == "edited"


@pytest.mark.skipif(os.name == "nt", reason="names there are text")
def test_a_report_is_written_into_a_folder_whose_name_is_no_text(tmp_path, capsys):
    out = os.fsdecode(os.fsencode(tmp_path) + b"/d\xe9")
    assert exit_code("sweep", write_small(tmp_path, trials=1), "--jobs", "1", "--out", out) == 0
    assert exit_code("report", out) == 0
    with open(os.path.join(out, "results.md"), encoding="utf-8") as file:
        assert r"/d\xe9'" in file.read()


def test_a_file_is_in_the_way_of_a_folder(file, tmp_path, capsys):
    for name in ("trials", "timings"):
        out = tmp_path / name
        assert sweep(file, out) == 0
        shutil.rmtree(out / name)
        (out / name).write_text("mine")
        assert sweep(file, out) == 2
        assert f"{out / name} is in the way of a folder" in capsys.readouterr().err
