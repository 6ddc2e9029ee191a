"""Reports whose numbers this code no longer gets are named, and made again: ``make reports``."""

import pytest
from deqmcl_command import exit_code, lines
from sweep_command import without_report, write_small

from deqmcl_gym.validation import InputError
from docs import report_runs
from docs.report_runs import Made, Report

OLD, NEW = "0" * 64, "f" * 64


@pytest.fixture
def reports(tmp_path, monkeypatch):
    folder = tmp_path / "reports"
    (folder / "sampled").mkdir(parents=True)
    monkeypatch.setattr(report_runs, "REPORTS", folder)
    monkeypatch.setattr(report_runs, "RUNS", tmp_path / "runs")

    def run(command, **_):
        if command[0] == "git":
            return type("Done", (), {"stdout": "abc+\n"})
        with without_report():
            return type("Done", (), {"returncode": exit_code(*command[3:])})

    monkeypatch.setattr(report_runs.subprocess, "run", run)
    command = f"sweep '{write_small(tmp_path)}'"
    small = Report(command=command, files={"small.csv": "results.csv"}, commit="old")
    report_runs.write(Made(OLD, {"small": small}))
    assert report_runs.main(["small", "--jobs", "1"]) == 0
    return folder


def test_a_report_is_made_again_with_its_files_and_the_commit(reports):
    assert {row["method"] for row in lines(reports, "small.csv")} == {"mcl", "dead-reckoning"}
    assert report_runs.read().reports["small"].commit == "abc+"
    with pytest.raises(InputError, match="there is no report large; there are small"):
        report_runs.main(["large"])


def test_a_change_that_no_record_feels_makes_nothing_stale(reports, monkeypatch, capsys):
    monkeypatch.setattr(report_runs, "code_digest", lambda: NEW)
    assert report_runs.main(["--check", "--jobs", "1"]) == 0
    assert "small: 3 trials, none differs" in capsys.readouterr().out
    assert report_runs.read().verified == OLD
    assert report_runs.main(["--jobs", "1"]) == 0
    assert report_runs.read().verified == NEW
    capsys.readouterr()
    assert report_runs.main(["--check"]) == 0  # and runs nothing
    assert "under this code" in capsys.readouterr().out


def test_a_record_that_differs_is_named_with_what_to_do(reports, capsys):
    sample = reports / "sampled" / "small.csv"
    text = sample.read_text()
    *_, last = text.split(",")
    sample.write_text(text.replace(last.strip(), OLD))
    assert report_runs.main(["--check", "--jobs", "1"]) == 1
    printed = capsys.readouterr().out
    assert "1 of 3 trials differ; the first" in printed
    assert "make reports ARGS='small'" in printed


def test_every_file_of_the_reports_is_of_one_run():
    made = report_runs.read().reports
    files = [file for report in made.values() for file in report.files]
    folder = report_runs.REPORTS
    held = [path.relative_to(folder).as_posix() for path in folder.glob("*/*.csv")]
    assert sorted(files) == sorted(name for name in held if not name.startswith("sampled/"))
    assert {path.stem for path in (folder / "sampled").iterdir()} <= made.keys()
