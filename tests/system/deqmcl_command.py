"""Run the ``deqmcl`` command, as a process or in this one."""

import re
import subprocess
import sys
import sysconfig
from pathlib import Path

from benchmarks.cli import main

DEQMCL = Path(sysconfig.get_path("scripts")) / "deqmcl"
SMALL = ("paper", "--trials", "2", "--particles", "100")
METHODS = ("mcl", "mcl-smoother", "mcl-map", "mcl-map-smoother", "deq-mcl", "dead-reckoning")


def process(*command, **how):
    """Run a command to its end; its output as text, without what it says of long waits."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=300, **how)
    done.stderr = re.sub(r"^deqmcl: .* …\n", "", done.stderr, flags=re.MULTILINE)
    return done


def python(code, *arguments, **how):
    """Run code in a fresh interpreter."""
    return process(sys.executable, "-c", code, *arguments, **how)


def exit_code(*arguments):
    """Run the command in this process; argparse leaves by SystemExit."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as end:
        return end.code


def files(folder):
    """Contents of all files below a folder, by path."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
