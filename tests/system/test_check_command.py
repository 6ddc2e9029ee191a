"""``deqmcl check`` and ``deqmcl new localizer``: what they print, write and refuse."""

import ast
import os
import signal
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
from deqmcl_command import DEQMCL, exit_code, files

from deqmcl_gym.maps import GridMap
from localizers.checks import LAWS, law_name

BROKEN = Path(__file__).parents[1] / "localizers" / "broken.py"


def test_a_good_localizer_gets_one_line_per_law_and_exit_code_0(capsys):
    assert exit_code("check", "dead-reckoning") == 0
    printed = capsys.readouterr()
    *laws, last = printed.out.splitlines()
    assert [line[9:].partition(":")[0] for line in laws] == [law_name(law) for law in LAWS]
    assert {line.split()[0] for line in laws} == {"ok", "skipped"}
    assert "skipped  one particle: it has no parameter particles" in laws
    assert last == "dead-reckoning keeps all laws of localizers (1 skipped)."
    assert printed.err == ""


def test_a_broken_localizer_gets_the_reason_in_one_line_and_exit_code_3(capsys):
    assert exit_code("check", f"{BROKEN}:Finite") == 3
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert [line[9:].partition(":")[0] for line in lines] == [law_name(law) for law in LAWS]
    assert "FAILED   finite: a pose of points(0) at step 1 is nan" in lines
    assert "skipped  max range scan: it fails 'finite'" in lines
    said = f"deqmcl: 1 of {len(LAWS)} laws failed: 'finite'. (--debug shows where)\n"
    assert printed.err == said


def test_a_localizer_that_hangs_breaks_the_law_of_time_and_no_other_is_tried(capsys):
    assert exit_code("check", f"{BROKEN}:AnswersInTime", "--timeout", "1") == 3
    first, *others = capsys.readouterr().out.splitlines()
    assert first == "FAILED   answers in time: no answer within 1 s; --timeout S allows more"
    assert len(others) == len(LAWS) - 1
    assert {line.partition(": ")[2] for line in others} == {"it fails 'answers in time'"}


def test_ctrl_c_ends_a_localizer_that_hangs():
    running = subprocess.Popen(
        [DEQMCL, "check", f"{BROKEN}:AnswersInTime"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )
    while "trying the law 'answers in time'" not in running.stderr.readline():
        assert running.poll() is None
    os.killpg(running.pid, signal.SIGINT)  # as a terminal does
    _, said = running.communicate(timeout=60)  # until its worker, too, has closed stderr
    assert (running.returncode, said) == (130, "deqmcl: interrupted.\n")


def test_a_process_that_dies_and_a_bad_time_limit_are_told(tmp_path, capsys, refusal):
    (tmp_path / "mine.py").write_text("import os\ndef dies(robot):\n    os._exit(7)\n")
    assert exit_code("check", f"{tmp_path}/mine.py:dies") == 3
    first = capsys.readouterr().out.splitlines()[0]
    assert first == "FAILED   answers in time: its worker died with exit code 7"
    refusal(["check", "mcl", "--timeout", "0"], "--timeout is 0", "above 0")


def test_the_laws_can_be_tried_on_a_map_of_ones_own(tmp_path, capsys):
    (tmp_path / "cells.py").write_text(
        "from localizers.template import MyLocalizer\n"
        "class CellsOnly(MyLocalizer):\n"
        "    def __init__(self, robot):\n"
        "        super().__init__(robot)\n"
        "        self.shape = robot.floor_plan.occupancy.shape\n"
    )
    cells = np.zeros((60, 80), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[20:30, 30:40] = 100
    GridMap(occupancy=cells, resolution=0.1).save(tmp_path / "hall.yaml")
    name = f"{tmp_path}/cells.py:CellsOnly"
    assert exit_code("check", name) == 3
    assert "If it is for maps of cells alone, give one: --map" in capsys.readouterr().err
    assert exit_code("check", name, "--map", tmp_path / "hall.yaml") == 0
    verdicts = capsys.readouterr().out.splitlines()[: len(LAWS)]
    others = [line for line in verdicts if not line.startswith("ok ")]
    assert others == ["skipped  one particle: it has no parameter particles"]


def test_a_new_localizer_has_one_definition_and_is_short(tmp_path):  # it runs: docs/test_pages
    path = tmp_path / "my_localizer.py"
    assert exit_code("new", "localizer", path) == 0
    body = ast.parse(path.read_text()).body
    defined = [node.name for node in body if isinstance(node, ast.ClassDef | ast.FunctionDef)]
    assert defined == ["MyLocalizer"]
    code = [line for line in path.read_text().splitlines() if line.strip()]
    assert len(code) <= 35


def test_what_exists_is_not_overwritten(tmp_path, refusal):
    (tmp_path / "link.py").symlink_to("nowhere.py")
    (tmp_path / "mine.py").write_text("precious")
    for name in ("mine.py", "link.py"):
        refusal(["new", "localizer", tmp_path / name], "already exists")
    assert files(tmp_path) == {"mine.py": b"precious"}
