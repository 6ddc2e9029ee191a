"""Reports of other code are named, verified by their sample, or made again: ``make reports``."""

import csv

import pytest
from deqmcl_command import exit_code
from sweep_command import without_report, write_small

from docs.numbers import made, remake
from docs.numbers.made import Report

OLD, NEW = "0" * 64, "f" * 64


@pytest.fixture
def reports(tmp_path, monkeypatch):
    """A folder of reports with one, of a small sweep, that was made by other code."""
    folder = tmp_path / "reports"
    (folder / "sampled").mkdir(parents=True)
    monkeypatch.setattr(made, "REPORTS", folder)
    monkeypatch.setattr(remake, "FOLDERS", tmp_path / "runs")
    monkeypatch.setattr(remake.pages, "main", lambda: None)
    command = f"sweep '{write_small(tmp_path)}'"
    small = Report(command=command, files={"small.csv": "results.csv"}, code=OLD, on="2026-11-22")
    made.write({"small": small})
    return folder


@pytest.fixture
def runs(monkeypatch):
    """Commands that were run, in this process and without pictures."""
    commands = []

    def run(command, **_):
        commands.append(command[3:])
        with without_report():
            return type("Done", (), {"returncode": exit_code(*command[3:])})

    monkeypatch.setattr(remake.subprocess, "run", run)
    return commands


def under(code, monkeypatch):
    """From here on the code has this digest."""
    monkeypatch.setattr(remake, "code_digest", lambda: code)


def renew(*words):
    return remake.main([*words, "--jobs", "1"])


def test_what_is_stale_is_named_made_again_and_verified_under_other_code(
    reports, runs, monkeypatch, capsys
):
    assert renew("--dry-run") == 1
    assert "1 of 1 reports are stale" in (said := capsys.readouterr().out)
    assert "small: of code 000000000000" in said
    assert "never timed" in said
    assert renew("--verify") == 1  # there is no sample yet
    assert runs == []
    assert renew() == 0
    assert len(runs) == 1
    with (reports / "small.csv").open() as file:
        assert {row["method"] for row in csv.DictReader(file)} == {"mcl", "dead-reckoning"}
    capsys.readouterr()
    assert renew() == 0
    assert "Nothing is to be done" in capsys.readouterr().out
    under(NEW, monkeypatch)
    assert renew("--dry-run") == 1
    assert renew("--verify") == 0
    assert made.read()["small"].verified.code == NEW
    capsys.readouterr()
    assert renew("--dry-run") == 0
    assert "0 of 1 reports are stale; 1 are of this code" in capsys.readouterr().out
    assert len(runs) == 1


def test_a_trial_of_the_sample_that_differs_makes_the_report_again(
    reports, runs, monkeypatch, capsys
):
    assert renew() == 0
    sample = reports / "sampled" / "small.csv"
    kept = sample.read_text()
    *_, last = kept.split(",")
    sample.write_text(kept.replace(last.strip(), OLD))
    under(NEW, monkeypatch)
    before = made.read()
    assert renew("--verify") == 1
    assert "1 of 3 trials differ; the first" in capsys.readouterr().out
    assert made.read() == before
    assert renew() == 0
    assert len(runs) == 2
    assert sample.read_text() == kept
    assert made.read()["small"].code == before["small"].code
    assert made.read()["small"].verified is None


def test_every_file_of_the_reports_is_of_one_run():
    files = [file for report in made.read().values() for file in report.files]
    held = [path.relative_to(made.REPORTS).as_posix() for path in made.REPORTS.glob("*/*.csv")]
    assert sorted(files) == sorted(name for name in held if not name.startswith("sampled/"))
    sampled = {path.stem for path in (made.REPORTS / "sampled").iterdir()}
    assert sampled <= made.read().keys()
