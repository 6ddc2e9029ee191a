"""One run: a localizer on the records of a log, in whichever process."""

import contextlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.execution.apart import checked_apart, parameters
from benchmarks.replay.agreement import agreement
from benchmarks.replay.playing import replay
from benchmarks.replay.setting import EVERY, Setting, robot_of
from benchmarks.setup.changes import Changes
from benchmarks.trials.attempt import Outcome
from deqmcl_gym.validation import InputError, in_words, integer
from localizers import make
from localizers.naming.isolation import is_ctrl_c
from localizers.naming.registry import is_plug_in

_PARTICLES = "particles", "max_particles"


@dataclass(frozen=True, kw_only=True)
class Run:
    """A localizer on a log.

    Attributes:
        setting: the log, on its map.
        localizer: its name.
        params: its parameters.
        root, seed: of its randomness; the same for every localizer.
    """

    setting: Setting
    localizer: str
    params: Changes
    root: int
    seed: int

    @property
    def key(self) -> str:
        """Its name among all of one command."""
        return f"{self.localizer} {self.seed}"

    @property
    def guest(self) -> str:
        """The localizer's name if it is a plug-in, else ""."""
        return self.localizer if is_plug_in(self.localizer) else ""


def runs_of(
    setting: Setting,
    localizers: Sequence[str],
    *,
    particles: int | None,
    seeds: int,
    root: int,
    shared: Mapping[str, Mapping[str, Any]],
    own: Mapping[str, Mapping[str, Any]],
) -> dict[str, Run]:
    """Return all runs by their keys, those of one seed after another.

    A localizer has the parameters of ``shared`` by its name, else as many particles as are asked
    for, None: its own default; what is its ``own`` comes before both.

    Raises:
        InputError: an unknown localizer, one named twice, or a number out of range.
    """
    if particles is not None:
        integer("--particles", particles, low=1)
    integer("--seeds", seeds, low=1, high=10_000)
    integer("--seed", root)
    if not localizers:
        raise InputError("--localizers names none: name one or more, comma-separated.")
    if len(set(localizers)) < len(localizers):
        raise InputError(f"a localizer is named twice in {', '.join(localizers)}.")
    params = {
        name: Changes({**(shared.get(name) or _given(name, particles)), **own.get(name, {})})
        for name in localizers
    }
    runs = [
        Run(
            setting=setting,
            localizer=name,
            params=params[name],
            root=root,
            seed=seed,
        )
        for seed in range(seeds)
        for name in localizers
    ]
    return {run.key: run for run in runs}


def guest_of(run: Run) -> str:
    """Return the name of a run's plug-in; "" if all is ours."""
    return run.guest


def check(runs: Mapping[str, Run]) -> None:
    """Let each localizer look at its parameters, before anything is run or written.

    Raises:
        InputError: it refuses them. Any other trouble of a plug-in is left to its runs.
    """
    for run in {run.localizer: run for run in runs.values()}.values():
        if run.guest:
            checked_apart(_look, run)
        else:
            _look(run)


def _look(run: Run) -> None:
    try:
        with contextlib.chdir(os.curdir):  # comes back, wherever a localizer goes
            robot, _ = robot_of(run.setting, run.setting.env())
            make(run.localizer, robot, **dict(run.params))
    except BaseException as error:
        if isinstance(error, InputError) or is_ctrl_c(error):
            raise


def attempt(run: Run, key: str) -> Outcome:
    """Play a log to a localizer; an error becomes the reason why the run failed.

    The outcome's record holds its ``Track`` and its agreement with the map.
    """
    del key
    try:
        with contextlib.chdir(os.curdir):  # comes back, wherever a localizer goes
            env = run.setting.env()
            robot, prior = robot_of(run.setting, env)
            localizer = make(run.localizer, robot, **dict(run.params))
            seeds = np.random.SeedSequence(run.root, spawn_key=(run.seed,))
            track = replay(env, localizer, prior, np.random.default_rng(seeds))
            agreed = agreement(env.log, env.floor_plan, track.best)
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        return Outcome(reason=in_words(error))
    found: Any = {"track": track, "agreement": agreed}
    return Outcome(record=found, seconds=track.seconds.sum())


def gated(runs: Mapping[str, Run], every: object) -> list[str]:
    """Return the note that ``amcl`` will update less often than on a robot; none if it will not."""
    waits = [run for run in runs.values() if run.localizer == "amcl"]
    if (
        every is not None
        or not waits
        or {"update_min_d", "update_min_a"} & dict(waits[0].params).keys()
    ):
        return []
    return [
        "amcl updates when the robot has moved 0.25 m or turned 0.2 rad, as Nav2's does, but only "
        f"records {EVERY} apart are played, so it updates less often than on a robot: add --every "
        "0.0625m,3deg for that, or --param amcl.update_min_d=0 --param amcl.update_min_a=0 to "
        "update at each record."
    ]


def _given(name: str, particles: int | None) -> Mapping[str, Any]:
    """Return the number of particles by whatever name a localizer takes it."""
    if particles is None:
        return {}
    taken = parameters(name)
    given: dict[str, Any] = {
        word: particles for word in _PARTICLES if taken is not None and word in taken
    }
    if taken is not None and "min_particles" in taken:
        given["min_particles"] = min(particles, 500)
    return given
