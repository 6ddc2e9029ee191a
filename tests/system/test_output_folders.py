"""Where a command writes: into folders of its own, and over nothing that is somebody else's."""

import os
import shutil
from pathlib import Path

import pytest
from deqmcl_command import exit_code, files
from sweep_command import write_small

FEW = ("--particles", "20", "--lag", "3")
WRITERS = {
    "sweep": ("sweep", "quick", "--jobs", "1"),
    "paper": ("paper", "--trials", "1", "--localizers", "dead-reckoning", *FEW, "--jobs", "1"),
    "run": ("run", "--localizer", "dead-reckoning", *FEW),
    "report": ("report",),
}


@pytest.fixture(scope="module")
def lap(tmp_path_factory):
    """The folder of ``deqmcl run``."""
    out = tmp_path_factory.mktemp("lap")
    assert exit_code(*WRITERS["run"], "--out", out) == 0
    return out


@pytest.fixture
def refused(finished, refusal):
    """Refuse an output folder by name and leave it as it is."""

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


def test_a_lap_is_run_again_into_its_folder_beside_a_file_of_the_users(lap, refusal):
    before = files(lap)
    (lap / "notes.txt").write_text("mine")
    (lap / "error.csv").write_text("edited")
    assert exit_code(*WRITERS["run"], "--out", lap) == 0
    assert files(lap) == before | {"notes.txt": b"mine"}


@pytest.mark.skipif(os.name == "nt", reason="names there are text")
def test_a_report_is_written_into_a_folder_whose_name_is_no_text(tmp_path):
    out = os.fsdecode(os.fsencode(tmp_path) + b"/d\xe9")
    assert exit_code("sweep", write_small(tmp_path, trials=1), "--jobs", "1", "--out", out) == 0
    assert exit_code("report", out) == 0
    with open(os.path.join(out, "report.html"), encoding="utf-8") as file:
        assert r"/d\xe9&#39;" in file.read()
