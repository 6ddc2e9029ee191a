"""One trial: set up in its disturbances, and run to its record or the reason why it has none."""

import contextlib
import inspect
import multiprocessing
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Self

import gymnasium as gym
import numpy as np

from benchmarks.setup import Agent, TrialEnv
from benchmarks.setup.documents import digest_of_file, errors_name
from benchmarks.setup.names import AGENT, make_agent, plug_ins_of, scenario, scenario_digest
from benchmarks.setup.scenario import RoomScenario, Scenario
from benchmarks.trials import Provenance, Trial, code_digest, stream, versions
from benchmarks.trials.clouds import Surroundings
from benchmarks.trials.episode import Step, drive, followed, sees_belief
from benchmarks.trials.scores import ScoreGroup, groups_named
from benchmarks.trials.scoring import TrialRecord, record
from benchmarks.trials.trace import JourneyLog, Trace, TrackLog
from benchmarks.trials.tracks import is_symmetric
from deqmcl_gym.envs.wrappers import BeamDropout, Kidnap, PlanChange
from deqmcl_gym.numerics import Pose
from deqmcl_gym.validation import InputError, LogWarning, in_words, one_of
from localizers import Prior, RobotModel, absolute_name, make
from localizers.kinds import is_ctrl_c, raised
from localizers.registry import LOCALIZER, SCAN_MODEL

DISTURBANCES = {"kidnap": Kidnap, "dropout": BeamDropout, "plan-change": PlanChange}
Drive = tuple[Pose, tuple[Step, ...]]  # an expected start, and an episode without any belief


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A trial, set up: all that it is made of, but for its agent and localizer."""

    trial: Trial
    #: with the trial's changes, in its building; the trial's disturbances are outside its own
    scenario: Scenario
    room: TrialEnv
    env: gym.Env[Any, Any]  #: the room inside its disturbances
    robot: RobotModel  #: what the localizer and the agent are made for

    @classmethod
    def of(cls, trial: Trial) -> Self:
        """Set a trial up; nothing is run."""
        changed = scenario(trial.scenario).changed(trial.world, trial.assumed)
        setup = changed.in_building(trial.trial)
        disturbance = *setup.disturbance, *trial.disturbance
        setup = replace(setup, agent=trial.agent or setup.agent, disturbance=disturbance)
        with _errors_name(trial.scenario):
            room = setup.room()
        env, robot = disturbed(room.unwrapped, disturbance), setup.robot_model(room)
        return cls(trial=trial, scenario=setup, room=room, env=env, robot=robot)

    @property
    def task(self) -> Surroundings:
        """What scoring must know of the world."""
        return Surroundings(
            floor_plan=self.room.floor_plan,
            radius=self.room.radius,
            max_range=self.room.lidar.max_range,
            thresholds=self.scenario.thresholds,
        )

    @property
    def groups(self) -> tuple[ScoreGroup, ...]:
        """The groups of scores that the trial is about.

        Where a half turn gives the same map, two places fit a robot that may be lost.
        """
        about = set(self.scenario.scores)
        if "lost" in about and is_symmetric(self.room.floor_plan):
            about.add("ambiguity")
        return groups_named(about)

    @property
    def stream(self) -> np.random.Generator:
        """The localizer's stream: ``Trial.filter_rng``, but on a whole log with a shorter key."""
        if self.scenario.judged is None:
            return self.trial.filter_rng()
        number, run = self.trial.run
        return stream(self.trial.seed, number, *((run,) if run else ()))

    def collector(self) -> JourneyLog | TrackLog | None:
        """Return what keeps its journey, or its track on a whole log; None if nothing is asked."""
        if self.scenario.judged is None:
            return JourneyLog(self.task, self.groups) if self.groups else None
        from deqmcl_gym.envs.log import LogEnv  # a trial in a room needs none

        assert isinstance(self.room, LogEnv)
        thresholds, judged = self.scenario.thresholds, self.scenario.judged
        return TrackLog(self.room.log, self.room.floor_plan, thresholds, judged)

    def prior(self, start: Pose | None = None) -> Prior:
        """Return p(x_0) in the episode that the room has begun last, or in one with this start."""
        return self.scenario.prior_in(self.room, self.trial.start_rng(), start)

    def driven(self) -> Drive | None:
        """Run the episode for any localizer; None if it may depend on which one it is."""
        if sees_belief(agent := self._agent()):
            return None
        steps = drive(self.env, agent, lambda: None, seed=self.trial.world_seed)
        first = next(steps)
        return self.room.expected_start, (first, *steps)

    def moments(self, driven: Drive | None = None) -> Iterator[Step]:
        """Run the trial, or let its localizer follow what was ``driven``; yield each step.

        What the localizer is made for is a copy of its own.
        """
        start, steps = driven or (None, None)

        def run(believed: Callable[[], Any]) -> Iterable[Step]:
            return steps or drive(self.env, self._agent(), believed, seed=self.trial.world_seed)

        copies: dict[int, Any] = {}  # the prior's map is the robot's
        localizer = make(self.trial.localizer, deepcopy(self.robot, copies), **self.trial.params)
        return followed(run, localizer, lambda: deepcopy(self.prior(start), copies), self.stream)

    def trace(self, driven: Drive | None = None) -> Trace:
        """Run the trial, as ``moments`` does, and return its trace."""
        return Trace(self.moments(driven), self.trial.offsets, self.task, self.collector())

    def check(self) -> None:
        """Begin an episode, make the agent and what the filters assume, without running it."""
        with _errors_name(self.trial.scenario):
            self.env.reset(seed=self.trial.world_seed)
            self.prior()
            self.robot.scan_model()
        self._agent()

    def _agent(self) -> Agent:
        with _errors_name(self.trial.scenario):
            return make_agent(self.scenario.agent, self.robot)


def check_trials(trials: Iterable[Trial]) -> None:
    """Build each world, what its filters assume, its agent, and each localizer there, once."""
    worlds: dict[str, dict[str, Trial]] = {}  # trials by method, by setting and agent
    for trial in trials:
        setting = trial.scenario, trial.world, trial.assumed, trial.disturbance, trial.agent
        methods = worlds.setdefault(repr(setting), {})
        methods.setdefault(repr((trial.localizer, trial.params)), trial)
    for methods in worlds.values():
        stage = Stage.of(next(iter(methods.values())))
        stage.check()
        for trial in methods.values():
            make(trial.localizer, stage.robot, **trial.params)


def _errors_name(scenario_name: str) -> AbstractContextManager[None]:
    return errors_name(Path(scenario_name) if scenario_name.endswith(".toml") else None)


def disturbed(env: gym.Env[Any, Any], wrappers: Iterable[Mapping[str, Any]]) -> gym.Env[Any, Any]:
    """Return ``env`` inside its wrappers, innermost first: {"kind": "kidnap", "step": 100}."""
    for wrapper in wrappers:
        arguments = dict(wrapper)
        if "kind" not in arguments:
            raise InputError(
                f"a disturbance has no kind ({arguments}): allowed values: "
                f"{', '.join(DISTURBANCES)}."
            )
        kind = one_of("kind of disturbance", arguments.pop("kind"), DISTURBANCES)
        accepted = dict(list(inspect.signature(DISTURBANCES[kind]).parameters.items())[1:])
        for name in arguments:
            one_of(f"key of disturbance {kind!r}", name, accepted)
        for name, parameter in accepted.items():
            if parameter.default is parameter.empty and name not in arguments:
                raise InputError(f"the disturbance {kind!r} needs {name}: write {name} = ….")
        env = DISTURBANCES[kind](env, **arguments)
    return env


def provenance_of(trials: Iterable[Trial]) -> Provenance:
    """Return what the numbers of these trials depend on, as it is now."""
    localizer, setup = cache(LOCALIZER.digest), cache(scenario_digest)  # a file is read once
    digests: dict[str, str] = {}
    for trial in trials:
        parts = [(trial.localizer, localizer(absolute_name(trial.localizer)))]
        parts.append((trial.scenario, setup(absolute_name(trial.scenario))))
        if trial.agent is not None:
            parts.append((trial.agent.name, AGENT.digest(trial.agent.name)))
        scans = plug_ins_of(None, trial.assumed.get("scan.kind"))
        parts += [(name, SCAN_MODEL.digest(name)) for name in scans]
        parts += [(path, digest_of_file(path)) for path in trial.world.files]
        for name, digest in parts:
            if digests.setdefault(name, digest) != digest:
                raise InputError(
                    f"two files are called {name}, one from the folder of the sweep file and one "
                    "from another folder: give the path of one of them from /."
                )
    plug_ins = {str(name): digest for name, digest in digests.items() if digest}
    return Provenance(code_digest(), versions(), plug_ins)


def key_of(trial: Trial) -> str:
    """Return the name under which a trial's result is kept."""
    return provenance_of([trial]).key(trial)


def guest_of(trial: Trial) -> str:
    """Return the names of a trial's plug-ins: all that are not ours; "" if none is."""
    localizer = (trial.localizer,) if LOCALIZER.is_plug_in(trial.localizer) else ()
    base = scenario(trial.scenario)
    usual = plug_ins_of(base.agent, getattr(base.scan, "kind", None))
    return " ".join((*localizer, *usual, *plug_ins_of(trial.agent, trial.assumed.get("scan.kind"))))


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a trial: a record with the seconds it took, or a reason."""

    record: TrialRecord | None = None
    seconds: float = 0.0
    reason: str | None = None


@lru_cache(maxsize=2)
def _driven(episode: Trial, key: str) -> Drive | None:
    """Return what is driven once for all methods; its ``key`` names all that it depends on."""
    return Stage.of(episode).driven()


def attempt(trial: Trial, key: str) -> Outcome:
    """Run one trial; an error becomes its reason to have failed.

    A worker that would have another ``key`` for it has loaded other code, libraries or plug-ins.
    """
    try:
        with contextlib.chdir(os.curdir), warnings.catch_warnings():  # localizers may go
            warnings.simplefilter("ignore", LogWarning)  # shown when the sweep was checked
            in_main = multiprocessing.parent_process() is None
            loaded = LOCALIZER.added if in_main else LOCALIZER.received
            if trial.localizer not in loaded and key_of(trial) != key:
                return Outcome(
                    reason="its worker loaded other code, libraries or plug-in than the sweep: "
                    "run the command again, with the same on every machine"
                )
            stage = Stage.of(trial)
            repeats = isinstance(stage.scenario, RoomScenario)
            alike = _driven(trial.episode, key_of(trial.episode)) if repeats else None
            trace = stage.trace(alike)
            result = record(trace)
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        return Outcome(reason=in_words(error) if isinstance(error, InputError) else raised(error))
    if trace.steps == 0:
        return Outcome(reason="it processed 0 steps")
    return Outcome(record=result, seconds=trace.seconds)
