"""What a user is told while waiting: in a terminal, and without one a line a minute."""

import io
import re
import sys
import time

import pytest

from benchmarks import console
from benchmarks.sweeps import running
from benchmarks.sweeps.running import counted

LINE = re.compile(r"deqmcl: night: (\d) of 4 done after \d+:\d\d, (\?|\d+:\d\d) left(, 1 failed)?")


def test_each_minute_a_line_says_what_is_done_and_what_is_left(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(running, "MINUTE", 0.05)
    with counted(tmp_path / "night", 4, 3) as count:
        time.sleep(0.2)
        count(True)
        time.sleep(0.2)
        count(False)
    lines = [LINE.fullmatch(line) for line in capsys.readouterr().err.splitlines()]
    assert all(lines)
    assert [line[1] for line in lines] == sorted(line[1] for line in lines)
    assert {line.groups() for line in lines} >= {("1", "?", None), ("2", "00:00", ", 1 failed")}


@pytest.mark.parametrize("shown", [True, False])
def test_a_run_of_less_than_a_second_says_nothing(tmp_path, capsys, shown):
    with counted(tmp_path, 2, 2, shown=shown) as count:
        count(False)
        count(False)
    assert capsys.readouterr().err == ""


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
def test_only_what_takes_long_is_told(monkeypatch, stream):
    monkeypatch.setattr(console, "PATIENCE", 0.2)
    monkeypatch.setattr(sys, "stderr", stream())
    with console.doing("blinking"):
        pass
    assert sys.stderr.getvalue() == ""
    with console.doing("sleeping"):
        time.sleep(0.5)
    said = sys.stderr.getvalue()
    if stream is Terminal:
        first, blank, end = said.split("\r")[1:]
        assert (first, blank, end) == ("sleeping … 0 s", " " * len(first), "")
    else:
        assert said == "deqmcl: sleeping …\n"


def test_the_bar_names_the_sweep_and_counts_failures(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with counted(tmp_path / "quick", 4, 3) as count:
        count(False)
        count(True)
        count(True)
    first, *_, last = sys.stderr.getvalue().strip().split("\r")
    assert first.startswith("quick:  25%")
    assert "failed" not in first
    assert "2 failed" in last
