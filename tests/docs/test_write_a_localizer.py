"""The page on writing a localizer: its commands run, its code is the template, its laws are all."""

import csv
import math
import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

from benchmarks.cli import main
from localizers import template
from localizers.checks import LAWS, check_localizer

NAMED = "./my_localizer.py:MyLocalizer"
PAGE = (Path(__file__).parents[2] / "docs" / "write-a-localizer.md").read_text()


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_the_commands_work_as_they_stand_one_after_the_other(tmp_path):
    (commands,) = blocks("sh")
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    for command in commands.splitlines():
        assert command.startswith("deqmcl ")
        done = subprocess.run(
            command.split(),
            cwd=tmp_path,
            env=os.environ | {"PATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{command}: {done.stderr}"
    results = tmp_path / "results" / "mine"
    with (results / "results.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["method"] == NAMED]
    assert {row["offset"] for row in rows} >= {"0"}
    assert all(math.isfinite(float(row["error"])) for row in rows if row["offset"] == "0")
    assert NAMED in (results / "report.html").read_text()


def test_the_code_shown_is_the_file_that_new_localizer_writes():
    assert Path(template.__file__).read_text() in blocks("python")


def test_the_pytest_shown_passes_with_the_file_that_new_localizer_writes(tmp_path):
    assert main(["new-localizer", str(tmp_path / "my_localizer.py")]) == 0
    (shown,) = blocks("python notest")
    (tmp_path / "test_mine.py").write_text(shown)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "."],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert f"{len(LAWS)} passed" in done.stdout


def test_the_table_names_all_laws_in_their_order():
    section = PAGE.partition("## The laws")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| ([a-z ]+) \| .+ \|$", section, re.MULTILINE)
    assert rows == ["law", *(law.name for law in LAWS)]


def test_the_localizer_that_follows_the_plan_keeps_all_laws(tmp_path):
    (code,) = (block for block in blocks("python") if "class PlanFollower" in block)
    (tmp_path / "follower.py").write_text(code)
    report = check_localizer(f"{tmp_path / 'follower.py'}:PlanFollower")
    assert report.passed, str(report)
