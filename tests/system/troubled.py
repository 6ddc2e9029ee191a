"""``deqmcl`` with localizers that misbehave, also in worker processes, which load this script."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

import localizers
from benchmarks.cli import main

FLAG = os.environ.get("TROUBLED_FLAG")  # a file: whoever finds it there removes it and dies


class Here:
    """Stays where it started; is troubled in its first update."""

    def __init__(self, trouble):
        self._trouble = trouble

    def reset(self, prior, plan, rng):
        self._poses = prior.sample(1, rng)
        return self

    def update(self, ranges, action, plan):
        self._trouble()
        return self

    def points(self, offset=0):
        return (self._poses.copy(), np.ones(1)) if offset == 0 else None


def sleep():
    time.sleep(1000)


def die_once():
    try:
        Path(FLAG).unlink()
    except FileNotFoundError:
        return
    os.kill(os.getpid(), signal.SIGKILL)


for trouble in (sleep, die_once):
    localizers.register(trouble.__name__.replace("_", "-"), lambda robot, t=trouble: Here(t))

if __name__ == "__main__":
    sys.exit(main())
