"""Progress without a terminal: a line a minute, and nothing more."""

import re
import time

import pytest

from benchmarks.sweeps import running
from benchmarks.sweeps.running import counted

LINE = re.compile(
    r"deqmcl: night: (\d) of 4 done after \d\d:\d\d, (\?|\d\d:\d\d) left(, 1 failed)?"
)


def test_each_minute_a_line_says_what_is_done_and_how_long_the_rest_takes(
    tmp_path, monkeypatch, capsys
):
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
