"""Run the ``deqmcl`` command, as a process or in this one; what it has written."""

import csv
import json
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

from benchmarks.cli import main

DEQMCL = Path(sysconfig.get_path("scripts")) / "deqmcl"
SMALL = ("paper", "--trials", "2", "--particles", "100")
METHODS = ("mcl", "mcl-smoother", "mcl-map", "mcl-map-smoother", "deq-mcl", "dead-reckoning")


def process(*command, timeout=600, **how):
    """Run a command to its end; its output as text, without what it says of long waits."""
    words = [str(word) for word in command]
    how |= {"capture_output": True, "text": True, "timeout": timeout}
    done = subprocess.run(words, check=False, **how)
    done.stderr = re.sub(r"^deqmcl: .* …\n", "", done.stderr, flags=re.MULTILINE)
    return done


def python(*arguments, **how):
    """Run a script, or code after ``-c``, in a fresh interpreter that must succeed; its output."""
    done = process(sys.executable, *arguments, **how)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def exit_code(*arguments):
    """Run the command in this process; argparse leaves by SystemExit."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as end:
        return end.code


def files(folder):
    paths = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def lines(out, name="trials.csv"):
    with (out / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def stored(out):
    """The lines of all trials, by file: the same bytes if none was run."""
    return {path.name: path.read_bytes() for path in sorted(out.glob("trials*.jsonl"))}


def records(out):
    """The record of each finished trial, by key: it depends on nothing but the sweep."""
    texts = b"".join(stored(out).values()).splitlines(keepends=True)
    lines = [json.loads(text) for text in texts if text.endswith(b"\n")]
    return {line["key"]: line["record"] for line in lines if "record" in line}


def lose(out, *numbers):
    """Remove the trials of these lines, by default all; return their keys."""
    path = out / "trials.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    lost = [lines[number] for number in numbers] or lines
    path.write_text("".join(line for line in lines if line not in lost))
    return [json.loads(line)["key"] for line in lost]
