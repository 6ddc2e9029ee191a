"""The page on one's own map and log: its code records a log, its commands compare on it."""

import csv
import re
import shlex
import tomllib
from pathlib import Path

import numpy as np

from benchmarks.cli import main
from benchmarks.sweeps.sweepfile import sweep_of
from deqmcl_gym import logs

PAGE = (Path(__file__).parents[2] / "docs" / "your-map-your-log.md").read_text()
RECORD, REPLAY, _ = re.findall(r"^```python notest\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
STARTS, BUILDINGS = re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
(COMMANDS,) = re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_the_page_works_from_top_to_bottom(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(RECORD, "record", "exec"), {})
    for command in COMMANDS.splitlines():
        words = shlex.split(command)
        assert words[0] == "deqmcl"
        assert main([*words[1:], "--jobs", "1"]) == 0, capsys.readouterr().err
    with open("results/lap/results.csv", newline="") as file:
        found = {row["localizer"]: row for row in csv.DictReader(file)}
    columns = set(re.findall(r"`([a-z_0-9]+)`", PAGE.partition("| column |")[2].split("\n## ")[0]))
    assert columns - {"_low", "_high", "inf"} <= set(found["mcl"])
    assert float(found["mcl"]["position_median"]) < 0.1
    assert float(found["mcl"]["success_1m"]) == float(found["amcl"]["success_1m"]) == 1
    Path("starts.toml").write_text(STARTS)
    assert main(["sweep", "starts.toml", "--dry-run"]) == 0, capsys.readouterr().err
    capsys.readouterr()
    exec(compile(REPLAY, "replay", "exec"), {})
    estimate = np.array(re.findall(r"-?\d+\.\d+", capsys.readouterr().out), float)
    true = logs.read_tum("lap.tum").poses[-1]
    assert np.hypot(*(estimate - true)[:2]) < 0.2


def test_the_changes_for_the_two_buildings_make_a_sweep_of_the_one_above():
    given = tomllib.loads(STARTS)
    for key, value in tomllib.loads(BUILDINGS).items():
        given[key] = given[key] | value if isinstance(value, dict) else value
    sweep = sweep_of(given, title="starts")
    assert len(sweep.distinct()) == len(given["localizers"]) * 60 == 120
    assert dict(sweep.world)["segment"] == 50.0
