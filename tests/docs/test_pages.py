"""The pages that a user works through: their commands run, their code is what they say it is."""

import math
import os
import re
import shlex
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from bags import written
from deqmcl_command import exit_code, lines, python
from mcap.reader import make_reader
from test_documents import ROOT

from benchmarks.report import page
from benchmarks.trials.stage import DISTURBANCES
from deqmcl_gym import logs
from localizers import template
from localizers.checks import LAWS, check_localizer

FEWER = ("--particles 3000 --seeds 2", "--particles 300 --seeds 1")  # global: whether it runs
NAMED = "./my_localizer.py:MyLocalizer"
LOCALIZER, LOG, TUNE, WRONG, CLASSICAL, SWEEPS = (
    (ROOT / "docs" / f"{name}.md").read_text()
    for name in (
        *("write-a-localizer", "your-map-your-log", "tune-on-your-log"),
        *("wrong-map", "classical", "sweeps"),
    )
)


def blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```", page, re.MULTILINE | re.DOTALL)


LAWS_SHOWN, NODE, FEED, _ = blocks(LOCALIZER, "python notest")
RECORD, PLAYED = blocks(LOG, "python notest")


def test_the_commands_on_a_localizer_work_as_they_stand(here, capsys, monkeypatch):
    monkeypatch.setattr(page, "animations", lambda *_: ([], ""))
    (commands,) = blocks(LOCALIZER, "sh")
    said = []
    for command in commands.splitlines():
        fewer = ["--trials", "1", "--jobs", "1"] if command.startswith("deqmcl sweep") else []
        assert exit_code(*command.split()[1:], *fewer) == 0, capsys.readouterr().err
        said.append(capsys.readouterr().out)
    _, *then = commands.splitlines()
    assert [line.strip() for line in said[0].splitlines() if line.startswith("  deqmcl")] == then
    results = here / "results" / "mine"
    rows = {row["offset"]: row for row in lines(results, "results.csv") if row["method"] == NAMED}
    assert math.isfinite(float(rows["0"]["error"]))
    assert NAMED in (results / "report.html").read_text()


def test_the_command_that_writes_a_building_works(here):
    page = (ROOT / "docs" / "environment.md").read_text()
    (command,) = re.findall(r"^\.venv/bin/deqmcl (.*)$", page, re.MULTILINE)
    assert exit_code(*command.split()) == 0
    gym.make("deqmcl_gym/Journey-v1", floor_plan="maps/three/office.yaml")


def test_the_code_shown_is_the_file_that_new_localizer_writes():
    assert Path(template.__file__).read_text() in blocks(LOCALIZER, "python")


def test_the_pytest_shown_passes_with_the_file_that_new_localizer_writes(pytester):
    assert exit_code("new", "localizer", "my_localizer.py") == 0
    pytester.makepyfile(LAWS_SHOWN)
    done = pytester.runpytest_inprocess("-p", "no:cacheprovider")
    done.assert_outcomes(passed=len(LAWS))


def test_the_check_from_python_runs_as_a_file(tmp_path):
    (code,) = (block for block in blocks(LOCALIZER, "python") if "check_localizer" in block)
    (tmp_path / "checks.py").write_text(code)
    said = python(tmp_path / "checks.py", cwd=tmp_path)
    assert re.findall(r"^skipped .*", said, re.MULTILINE) == []


@pytest.fixture
def lap(here, monkeypatch):
    """A log; commands write no report, which would take longer than what it is of."""
    for module in ("report.page", "robots.replaying"):
        monkeypatch.setattr(f"benchmarks.{module}.no_report", lambda: "it is left out")
    exec(compile(RECORD, "record", "exec"), {})


def commands(page, *words):
    text = "".join(blocks(page, "sh")).replace("\\\n", "")
    others = "basin", "--mcap", "deqmcl score"
    return [x for x in text.splitlines() if any(w in x for w in words or others) == bool(words)]


def test_the_page_on_ones_own_log_works_from_top_to_bottom(lap, capsys):
    written(logs.read("lap.csv.gz"), Path("robot.mcap"))
    Path("map.yaml").write_text(Path("hall.yaml").read_text())
    Path("truth.tum").write_text(Path("lap.tum").read_text())
    (nav2,) = blocks(LOG, "yaml")
    Path("nav2_params.yaml").write_text(nav2)
    assert sum(FEWER[0] in command for command in commands(LOG)) == 1
    for command in commands(LOG):
        words = shlex.split(re.sub(r"--seeds \d", "--seeds 1", command.replace(*FEWER)))
        assert words[0] == "deqmcl"
        jobs = [] if words[1] == "smooth" else ["--jobs", "1"]
        assert exit_code(*words[1:], *jobs) == 0, capsys.readouterr().err
    assert "likelihood_field_prob" in capsys.readouterr().out
    found = {row["localizer"]: row for row in lines(Path("results/lap"), "results.csv")}
    table = LOG.partition("| column |")[2].split("\n\n")[0]
    columns = set(re.findall(r"`([a-z_0-9]+)`", table))
    assert len(columns) > 10
    assert columns - {"inf", "evo_ape", "evo_rpe"} <= set(found["mcl"])
    assert float(found["mcl"]["position_median"]) < 0.1
    assert float(found["mcl"]["success_1m"]) == float(found["amcl"]["success_1m"]) == 1
    assert Path("results/where/residuals.csv").is_file()
    smoothed, true = logs.read_tum("results/smooth/smoothed.tum"), logs.read_tum("lap.tum")
    off = smoothed.poses - true.poses[np.searchsorted(true.times, smoothed.times)]
    assert np.median(np.hypot(*off[:, :2].T)) < 0.1
    for name, text in (("starts.toml", LOG), ("known.toml", WRONG)):
        Path(name).write_text(blocks(text, "toml")[0])
        assert exit_code("sweep", name, "--dry-run") == 0, capsys.readouterr().err
    called: dict[str, Any] = {}
    exec(compile(PLAYED.replace("seeds=2", "seeds=1"), "played", "exec"), called)
    assert list(called["played"].table["localizer"]) == ["mcl", "amcl"]


def test_the_page_on_scoring_works_from_top_to_bottom(lap, capsys):
    log = logs.read("lap.csv.gz")
    poses = logs.read_tum("lap.tum").poses
    logs.Trajectory(log.times, poses + 0.1).write("theirs.tum")
    rows = [f"{t!r},{x!r},{y!r},{h!r}" for t, (x, y, h) in
            zip(log.times.tolist(), poses.tolist(), strict=True)]  # fmt: skip
    Path("theirs.csv").write_text("\n".join(["time,x,y,heading", *rows]))
    few = commands(LOG, "--seeds 3")[0].replace("--seeds 3", "--seeds 1 --jobs 1")
    for command in [few, *commands(TUNE, "deqmcl score")]:
        assert exit_code(*shlex.split(command)[1:]) == 0, capsys.readouterr().err
    rows = {row["localizer"]: row for row in lines(Path("results/beside"), "results.csv")}
    assert set(rows) == {"mcl", "amcl", "dead-reckoning", "theirs"}
    assert float(rows["theirs"]["position_median"]) == pytest.approx(math.hypot(0.1, 0.1), abs=1e-6)


def test_the_commands_on_classical_localizers_work(lap, capsys):
    for command in commands(CLASSICAL):
        few = command.replace("--trials 10", "--trials 1").replace("=20000 --seeds 2", "=600")
        few = few.replace("--out", "--seeds 1 --out" if "replay" in few else "--out")
        assert exit_code(*shlex.split(few)[1:], "--jobs", "1") == 0, capsys.readouterr().err
    assert Path("results/amcl-global/results.csv").is_file()


def test_starts_that_are_wrong_are_swept_as_the_page_says(lap, capsys, monkeypatch):
    monkeypatch.setattr(page, "no_report", lambda: None)
    monkeypatch.setattr(page, "animations", lambda *_: ([], ""))
    (command,) = commands(LOG, "basin")
    few = command.replace("[0,0.5,1,1.5,2,3]", "[0,3]")
    assert few != command
    fewer = "--set vary.assumed.prior.angle=[0,3.1416] --set params.mcl-map.particles=50 --trials 1"
    assert exit_code(*shlex.split(f"{few} {fewer} --jobs 1")[1:]) == 0, capsys.readouterr().err
    rows = lines(Path("results/basin"), "basin.csv")
    assert (rows[0]["runs"], rows[0]["localized"], len(rows)) == ("1", "1", 8)
    assert "Runs localized to the end" in Path("results/basin/report.html").read_text()


def test_what_foxglove_shows_is_what_the_page_says(lap, capsys):
    (command,) = commands(LOG, "--mcap")
    assert exit_code(*shlex.split(command)[1:], "--jobs", "1") == 0, capsys.readouterr().err
    with open("lap.mcap", "rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    topics = {re.sub("^/(mcl-plan-hedged|mcl)/", "/NAME/", one.topic) for one in channels}
    table = LOG.partition("| topic |")[2].split("\n\n")[0]
    assert topics == set(re.findall(r"`(/(?:NAME/)?[a-z]+)`", table)) - {"/NAME/past",
                                                                       "/NAME/future"}  # fmt: skip


@pytest.mark.slow
def test_the_commands_that_tune_work_as_the_page_says(lap, capsys):
    (space,) = blocks(TUNE, "toml")
    Path("space.toml").write_text(space)
    first, *others = commands(TUNE)
    first = first.replace("--candidates 36", "--candidates 2")
    for command in (first, *others, f"{first}-again --space space.toml"):
        assert exit_code(*shlex.split(command)[1:]) == 0, capsys.readouterr().err
    files = re.findall(r"^\| `([\w-]+\.\w+)` \|", TUNE, re.MULTILINE)
    assert files == ["tuned.md", "best.toml", "nav2.yaml", "tuned.csv", "candidates.csv",
                     "trade-off.png"]  # fmt: skip
    assert all(Path("results/tuned", name).is_file() for name in files)


def test_the_loop_of_a_robot_works_from_a_bag_as_the_page_says(lap, monkeypatch):
    monkeypatch.syspath_prepend(os.getcwd())
    Path("localization.py").write_text(NODE)
    written(logs.read("lap.csv.gz"), Path("robot.mcap"))
    names = {}
    exec(compile(FEED.replace("map.yaml", "hall.yaml"), "feed", "exec"), names)
    sys.modules.pop("localization")
    estimates, counts = names["estimates"], names["loop"].tracker.counts
    assert len(estimates) == counts.updates > 50
    assert counts.unusable + counts.late_scans + counts.scans_without_odometry == 0
    true = logs.read_tum("lap.tum").poses[-1]
    assert np.hypot(*(np.array(names["loop"].tracker.at().pose) - true)[:2]) < 0.2


def test_the_table_of_disturbances_has_all_and_no_others():
    _, table = SWEEPS.split("| disturbance | keys |\n")
    rows = table.split("\n\n")[0].splitlines()[1:]
    assert [re.match(r"\| `([\w-]+)` \|", row)[1] for row in rows] == list(DISTURBANCES)


def test_the_localizer_that_follows_the_plan_keeps_all_laws(tmp_path):
    (code,) = (block for block in blocks(LOCALIZER, "python") if "class PlanFollower" in block)
    (tmp_path / "follower.py").write_text(code)
    report = check_localizer(f"{tmp_path / 'follower.py'}:PlanFollower")
    assert report.passed, str(report)


@pytest.mark.parametrize("page", ["README.md", "docs/quickstart.md"])
def test_the_commands_to_begin_with_work(page, lap, capsys):
    commands = "".join(blocks((ROOT / page).read_text(), "sh")).replace("map.yaml", "hall.yaml")
    assert ("make paper" in commands) == (page == "README.md")
    for command in re.findall(r"^(?:\.venv/bin/)?deqmcl (.+)", commands, re.MULTILINE):
        words = re.sub(r"--trials \d+", "--trials 1", command).split()
        fewer = ["--set", "params.particles=100", *["--jobs", "1"] * (words[0] != "run")]
        fewer += ["--seeds", "1"] * (words[0] == "replay")
        assert exit_code(*words, *fewer) == 0, capsys.readouterr().err
