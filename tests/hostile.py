"""A localizer that does WHAT it is told, WHEN it is told: a test writes these lines anew."""

import os
import signal
import subprocess
import sys
import time

import numpy as np

from localizers.template import MyLocalizer

WHAT, WHEN, STARTED = "nothing", "never", ""


def recurse():
    recurse()


def start():
    with open(STARTED, "w") as file:
        print(subprocess.Popen(["sleep", "3600"]).pid, file=file)


def spoil_state():
    np.seterr(all="ignore")
    np.random.seed(0)  # noqa: NPY002
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    os.environ.clear()
    sys.stdout = sys.stderr = None


def die_once():
    """Only who finds the file STARTED dies, and nobody finds it again."""
    if os.path.exists(STARTED):
        os.unlink(STARTED)
        os.kill(os.getpid(), signal.SIGKILL)


def interrupt():
    raise KeyboardInterrupt


def close():
    raise GeneratorExit


DEEDS = {
    "nothing": lambda: None,
    "hang": lambda: time.sleep(3600),
    "exit": lambda: sys.exit(0),
    "end": lambda: os._exit(0),
    "die once": die_once,
    "interrupt": interrupt,
    "close": close,
    "recurse": recurse,
    "leave": lambda: os.chdir("/"),
    "spoil": spoil_state,
    "child": start,
}


def at(moment):
    if moment == WHEN:
        DEEDS[WHAT]()


class Believed:
    def __init__(self, belief):
        self.belief = belief

    def points(self, offset=0):
        at("points")
        return self.belief.points(offset)


class Hostile(MyLocalizer):
    def __init__(self, robot):
        at("make")
        super().__init__(robot, particles=20)

    def reset(self, prior, plan, rng):
        at("reset")
        return super().reset(prior, plan, rng)

    def update(self, ranges, action, plan):
        at("update")
        return Believed(super().update(ranges, action, plan))


at("import")
