"""The laws that every agent keeps: ``deqmcl check NAME --agent`` tries them on a short drive."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np

from benchmarks.checks import asked, require, tried
from benchmarks.setup.changes import Changes, Named
from benchmarks.setup.interfaces import Agent
from benchmarks.setup.names import absolute_agent, absolute_scenario, make_agent, plug_ins_of_agent
from benchmarks.trials.episode import moments
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.numerics.types import Reals
from deqmcl_gym.validation import InputError
from localizers import Belief, make
from localizers.api import Points
from localizers.checks.laws import Verdict
from localizers.checks.randomness import global_states

STEPS = 40
WORLDS = ("guided", "driving")  # the first that an agent does not refuse is the one it drives in
Answer = tuple[Reals, Reals | None]


class Empty:
    """A belief without a point."""

    def points(self, offset: int = 0) -> Points | None:
        """Return no poses, and no weights."""
        return np.empty((0, 3)), np.empty(0)


@dataclass
class _Watched:
    """An agent whose answers and inputs are looked at; see ``Agent``."""

    agent: Agent
    blind: bool = False
    answers: list[Answer] = field(default_factory=list)
    changed: str = ""  # what it has written into

    def __post_init__(self) -> None:
        self.sees_truth = getattr(self.agent, "sees_truth", False)

    def plan_at_reset(self, info: dict[str, Any]) -> Reals | None:
        before = deepcopy(info)
        plan = self.agent.plan_at_reset(info)
        self.changed = self.changed or ("" if _same(before, info) else "info at reset")
        return plan

    def act(self, belief: Belief, info: dict[str, Any]) -> Answer:
        if self.blind:
            belief = Empty()
        shown = belief.points()
        assert shown is not None
        kept, before = tuple(map(np.copy, shown)), deepcopy(info)
        answer = self.agent.act(belief, info)
        self.changed = self.changed or ("" if _same(before, info) else "info")
        again = belief.points()
        assert again is not None
        self.changed = self.changed or ("" if _same(kept, again) else "the belief")
        self.answers.append(deepcopy(answer))
        return answer


@dataclass(frozen=True)
class Drive:
    """An agent in a world, with a localizer of 50 particles."""

    agent: Named
    scenario: str

    def answers(self, *, blind: bool = False) -> list[Answer]:
        """Return what an agent, made anew, answers at each step of one and the same drive."""
        return self.watched(blind=blind).answers

    def watched(self, *, blind: bool = False) -> _Watched:
        """Return an agent, made anew, after the drive."""
        watched = _Watched(make_agent(self.agent, self._stage.robot), blind)
        for _ in islice(self._moments(watched), STEPS + 1):
            pass
        return watched

    def begun(self) -> None:
        """Make the agent and begin an episode."""
        next(self._moments(_Watched(make_agent(self.agent, self._stage.robot))))

    @property
    def _stage(self) -> Stage:
        trial = Trial(
            scenario=self.scenario,
            localizer="mcl-map",
            params=Changes({"particles": 50}),
            agent=self.agent,
            lag=0,
            seed=0,
            trial=0,
        )
        return Stage.of(trial)

    def _moments(self, agent: Agent) -> Iterator[object]:
        stage, rng = self._stage, np.random.default_rng(0)
        localizer = make("mcl-map", stage.robot, **stage.trial.params)
        return moments(
            stage.env,
            agent,
            localizer,
            stage.prior,
            rng,
            seed=stage.trial.world_seed,
        )


def answers_in_time(drive: Drive) -> None:
    """It answers at every step, without an exception, within the time limit."""
    drive.answers()


def answers_with_actions(drive: Drive) -> None:
    """An action is two finite numbers; a plan is None or finite rows (h, 2)."""
    for step, (action, plan) in enumerate(drive.answers()):
        shape = np.shape(action)
        require(shape == (2,), f"its action at step {step} has shape {shape}, not (2,)")
        require(bool(np.isfinite(action).all()), f"its action at step {step} is {action}")
        if plan is not None:
            rows = np.shape(plan)
            flat = len(rows) == 2 and rows[1] == 2
            require(flat, f"its plan at step {step} has shape {rows}, not (h, 2)")
            require(bool(np.isfinite(plan).all()), f"its plan at step {step} is not finite")


def same_rng_same_result(drive: Drive) -> None:
    """Two agents, made anew, answer alike to the same beliefs and scans."""
    first, second = drive.answers(), drive.answers()
    require(len(first) == len(second), "two drives with the same seeds differ in length")
    for step, (one, other) in enumerate(zip(first, second, strict=True)):
        require(
            _same(one, other),
            f"two drives with the same seeds differ from step {step} on: draw random numbers from "
            "numpy.random.default_rng of what it is shown, as of info['truth'] or info['route']",
        )


def inputs_not_changed(drive: Drive) -> None:
    """It writes neither into the belief nor into info."""
    changed = drive.watched().changed
    require(not changed, f"it changed {changed}: make a copy")


def global_rng_untouched(drive: Drive) -> None:
    """It neither seeds nor draws from the global generators of NumPy and Python."""
    before = global_states()
    drive.answers()
    require(global_states() == before, "it used a global generator: make one of your own")


def survives_an_empty_belief(drive: Drive) -> None:
    """It answers with finite actions to a belief without points."""
    for step, (action, _) in enumerate(drive.answers(blind=True)):
        finite = bool(np.isfinite(action).all())
        require(finite, f"its action at step {step} on an empty belief is {action}")


LAWS: tuple[Callable[[Drive], None], ...] = (
    answers_in_time,
    answers_with_actions,
    same_rng_same_result,
    inputs_not_changed,
    global_rng_untouched,
    survives_an_empty_belief,
)


def verdicts(name: str, scenario: str | None = None, *, timeout: float = 60.0) -> Iterator[Verdict]:
    """Try an agent against all laws, one after the other; a plug-in in processes of its own.

    Args:
        name: see ``make_agent``; ``file.py`` is its only agent.
        scenario: where it drives; by default the first of ``WORLDS`` that it does not refuse.
        timeout: s that a law may take.

    Raises:
        InputError: there is no such agent, or it refuses every world.
    """
    agent = absolute_agent(Named(name))
    worlds = WORLDS if scenario is None else (absolute_scenario(scenario),)
    foreign = bool(plug_ins_of_agent(agent))
    drive = asked(foreign, timeout, _world_of, agent, worlds)
    yield from tried(LAWS, drive, agent.name, foreign=foreign, timeout=timeout)


def _world_of(agent: Named, worlds: tuple[str, ...]) -> Drive:
    for world in worlds:
        try:
            Drive(agent, world).begun()
        except InputError as error:
            refusal = error
            continue
        except Exception:  # a law will say so
            pass
        return Drive(agent, world)
    raise refusal


def _same(before: Any, after: Any) -> bool:
    """Whether two nested values are equal, arrays by their elements."""
    if isinstance(before, dict):
        return before.keys() == after.keys() and all(_same(before[k], after[k]) for k in before)
    if isinstance(before, tuple):
        return len(before) == len(after) and all(map(_same, before, after))
    return bool(np.array_equal(before, after))
