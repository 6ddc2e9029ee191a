"""The laws of agents and of scan models, in the form of those of localizers (localizers.checks).

``deqmcl check NAME --agent`` tries an agent on a short drive, with a localizer of 50 particles;
``deqmcl check NAME --scan`` a scan model on scans and poses of a scenario's map.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np

from benchmarks.setup.interfaces import Agent
from benchmarks.setup.names import absolute_agent, absolute_scenario, make_agent
from benchmarks.setup.overrides import Named, Overrides
from benchmarks.trials.episode import moments
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.numerics.types import Reals, Singles
from deqmcl_gym.validation import InputError
from localizers import Belief, UniformPrior, absolute_name, make
from localizers.api import Points
from localizers.checks import LawBrokenError, Laws, Report
from localizers.checks.process import no_global_rng
from localizers.models.scan import Scan, ScanModel
from localizers.registry import SCAN_MODEL, is_code

DRIVEN_IN = ("guided", "driving")  # the first that an agent does not refuse
SCANNED_IN = ("sharp", "lost")  # the first that a scan model does not refuse
_STEPS = 40
FREE, ANYWHERE = 200, 100  # poses that a scan is held against; the last on and around the map
_SCANS = 100
# Of a model for which the truth is likelier than another pose in three scans of four, fewer than 60
# of 100 have a probability below 0.001 (binomial).
FEWEST = 60
_CLOSE = 1e-4  # of log-likelihoods: a sum in another order, as BLAS makes it for other sizes

_TRIAL: dict[str, Any] = {
    "localizer": "mcl-map",
    "params": Overrides({"particles": 50}),
    "lag": 0,
    "seed": 0,
    "trial": 0,
}

Answer = tuple[Reals, Reals | None]


def check_agent(name: str, scenario: str | None = None) -> "Report[AgentDrive]":
    """Return the verdicts of all laws on an agent.

    Args:
        name: see ``make_agent``; ``file.py`` is its only agent.
        scenario: where it drives; by default the first of ``DRIVEN_IN`` that it does not refuse.
    """
    agent = absolute_agent(Named(name))
    worlds = DRIVEN_IN if scenario is None else (absolute_scenario(scenario),)
    world = _accepting(worlds, lambda world: AgentDrive(agent, world).watched(0))
    return Report(name, AGENT_LAWS, AgentDrive(agent, world), agent.name.rpartition(":")[0])


def check_scan(name: str, scenario: str | None = None) -> "Report[ScanTests]":
    """Return the verdicts of all laws on a scan model."""
    kind = absolute_name(SCAN_MODEL.complete(name)) if is_code(name) else name
    worlds = SCANNED_IN if scenario is None else (absolute_scenario(scenario),)
    world = _accepting(worlds, lambda world: ScanTests(kind, world).model())
    return Report(name, SCAN_LAWS, ScanTests(kind, world), kind.rpartition(":")[0])


def _accepting(worlds: Sequence[str], begin: Callable[[str], object]) -> str:
    """Return the first world that is not refused."""
    for world in worlds:
        try:
            begin(world)
        except InputError as error:
            refusal = error
            continue
        except Exception:  # a law will say so
            pass
        return world
    raise refusal


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
            belief = _Empty()
        before = deepcopy((belief.points(), info))
        answer = self.agent.act(belief, info)
        for what, old, new in zip(
            ("the belief", "info"), before, (belief.points(), info), strict=True
        ):
            self.changed = self.changed or ("" if _same(old, new) else what)
        self.answers.append(deepcopy(answer))
        return answer


class _Empty:
    """A belief without a point."""

    def points(self, offset: int = 0) -> Points:
        return np.empty((0, 3)), np.empty(0)


def _same(before: Any, after: Any) -> bool:
    """Whether two nested values are equal, arrays by their elements."""
    if isinstance(before, dict):
        return before.keys() == after.keys() and all(_same(before[k], after[k]) for k in before)
    if isinstance(before, tuple):
        return len(before) == len(after) and all(map(_same, before, after))
    return bool(np.array_equal(before, after))


@dataclass(frozen=True)
class AgentDrive:
    """An agent in a world."""

    agent: Named
    scenario: str

    def answers(self) -> list[Answer]:
        """Return what an agent, made anew, answers at each step of one and the same drive."""
        return self.watched().answers

    def watched(self, steps: int = _STEPS, *, blind: bool = False) -> _Watched:
        """Return an agent, made anew, after the drive; all that a blind one sees is empty."""
        stage = Stage.of(Trial(scenario=self.scenario, agent=self.agent, **_TRIAL))
        agent = _Watched(make_agent(self.agent, stage.robot), blind)
        localizer = make("mcl-map", stage.robot, **stage.trial.params)
        rng, seed = np.random.default_rng(0), stage.trial.world_seed
        drive = moments(stage.env, agent, localizer, stage.prior, rng, seed=seed)
        for _ in islice(drive, steps + 1):
            pass
        return agent


@dataclass(frozen=True)
class ScanTests:
    """A scan model in a world, with poses and scans to try it on.

    Attributes:
        kind: name of the model.
        scenario: whose map, lidar and noise it is.
    """

    kind: str
    scenario: str

    def model(self) -> ScanModel:
        """Return the model, made anew."""
        return self._stage.robot.scan_model()

    @property
    def poses(self) -> Singles:
        """Poses as rows x, y, θ, free ones first, (3, n); a copy, as a model may write into it."""
        return self._poses.copy()

    def answers(self, number: int = 0, model: ScanModel | None = None) -> Reals:
        """Return what a model, made anew if none is given, says of the poses and a scan."""
        return (model or self.model()).log_likelihood(self.poses, self.scan(number))

    def scan(self, number: int, missing: float = 0.0) -> Scan:
        """Return what the lidar measures at a free pose, with a share of the beams missing."""
        robot, rng = self._stage.robot, np.random.default_rng((1, number))
        sigma = self._stage.room.lidar.sigma
        ranges = robot.lidar.ranges(robot.floor_plan, self._poses[:, number : number + 1])[0]
        ranges = np.abs(ranges + sigma * rng.standard_normal(ranges.size))
        ranges[rng.random(ranges.size) < missing] = np.nan
        return Scan.of(np.asarray(ranges, np.float64), robot.lidar.max_range)

    @cached_property
    def _poses(self) -> Singles:
        robot, rng = self._stage.robot, np.random.default_rng(0)
        prior = UniformPrior(floor_plan=robot.floor_plan, radius=robot.radius)
        free = prior.sample(FREE, rng)
        low, high = free.min(axis=0), free.max(axis=0)
        anywhere = rng.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low), (ANYWHERE, 3))
        return np.ascontiguousarray(np.vstack([free, anywhere]).T, np.float32)

    @cached_property
    def _stage(self) -> Stage:
        assumed = Overrides({"scan.kind": self.kind})
        return Stage.of(Trial(scenario=self.scenario, assumed=assumed, **_TRIAL))


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise LawBrokenError(otherwise)


def answers_with_actions(drive: AgentDrive) -> None:
    """At every step an action is two finite numbers; a plan is None or finite rows (h, 2)."""
    for step, (action, plan) in enumerate(drive.answers()):
        shape = np.shape(action)
        _require(shape == (2,), f"its action at step {step} has shape {shape}, not (2,)")
        _require(bool(np.isfinite(action).all()), f"its action at step {step} is {action}")
        if plan is not None:
            rows = np.shape(plan)
            flat = len(rows) == 2 and rows[1] == 2
            _require(flat, f"its plan at step {step} has shape {rows}, not (h, 2)")
            _require(bool(np.isfinite(plan).all()), f"its plan at step {step} is not finite")


def same_rng_same_result(drive: AgentDrive) -> None:
    """Two agents, made anew, answer alike to the same beliefs and scans."""
    first, second = drive.answers(), drive.answers()
    _require(len(first) == len(second), "two drives with the same seeds differ in length")
    for step, (one, other) in enumerate(zip(first, second, strict=True)):
        _require(
            _same(one, other),
            f"two drives with the same seeds differ from step {step} on: draw random numbers from "
            "numpy.random.default_rng of what it is shown, as of info['truth'] or info['route']",
        )


def inputs_not_changed(drive: AgentDrive) -> None:
    """It writes neither into the belief nor into info."""
    changed = drive.watched().changed
    _require(not changed, f"it changed {changed}: make a copy")


def global_rng_untouched(subject: AgentDrive | ScanTests) -> None:
    """It neither seeds nor draws from the global generators of NumPy and Python."""
    with no_global_rng("make a generator of your own"):
        subject.answers()


def survives_an_empty_belief(drive: AgentDrive) -> None:
    """It answers with finite actions to a belief without points."""
    for step, (action, _) in enumerate(drive.watched(blind=True).answers):
        finite = bool(np.isfinite(action).all())
        _require(finite, f"its action at step {step} on an empty belief is {action}")


AGENT_LAWS: Laws[AgentDrive] = dict.fromkeys(
    (
        answers_with_actions,
        same_rng_same_result,
        inputs_not_changed,
        global_rng_untouched,
        survives_an_empty_belief,
    )
)


def answers_with_numbers(scans: ScanTests) -> None:
    """It answers with (n,) numbers, finite or -inf, also where half of the beams are missing."""
    model = scans.model()
    for number in range(10):
        for missing in (0.0, 0.5):
            model.log_likelihood(scans.poses, scans.scan(number, missing))


def same_input_same_answer(scans: ScanTests) -> None:
    """Two models, made anew, answer alike, and so does one that has seen other scans."""
    model = scans.model()
    first, _, again = (scans.answers(number, model) for number in (0, 1, 0))
    _require(np.array_equal(first, again), "it answers otherwise after another scan")
    _require(np.array_equal(first, scans.answers()), "made anew, it answers otherwise")


def poses_and_scan_not_changed(scans: ScanTests) -> None:
    """It writes neither into the poses nor into the scan."""
    scan, poses = scans.scan(0), scans.poses
    ranges, usable = scan.ranges.copy(), scan.usable.copy()
    scans.model().log_likelihood(poses, scan)
    _require(np.array_equal(poses, scans.poses), "it changed the poses: make a copy")
    same = np.array_equal(ranges, scan.ranges, equal_nan=True)
    _require(same and np.array_equal(usable, scan.usable), "it changed the scan: make a copy")


def each_pose_by_itself(scans: ScanTests) -> None:
    """What it says of a pose does not depend on the other poses, nor on their order."""
    model = scans.model()
    order, whole = np.random.default_rng(2).permutation(FREE + ANYWHERE), scans.answers(model=model)
    for some in (order, order[:7]):
        poses = np.ascontiguousarray(scans.poses[:, some])
        own = model.log_likelihood(poses, scans.scan(0))
        alike = np.allclose(own, whole[some], rtol=_CLOSE, atol=_CLOSE)
        _require(alike, f"it says otherwise of the same poses in a batch of {some.size}")


def the_truth_is_likelier(scans: ScanTests) -> None:
    """The pose of a scan is mostly likelier than another free pose."""
    model, likelier = scans.model(), 0
    for number in range(_SCANS):
        two = np.ascontiguousarray(scans.poses[:, [number, (number + _SCANS) % FREE]])
        truth, other = model.log_likelihood(two, scans.scan(number))
        likelier += bool(truth > other)
    _require(
        likelier >= FEWEST,
        f"the truth is likelier than another free pose in {likelier} of {_SCANS} scans, but must "
        f"be in {FEWEST}",
    )


SCAN_LAWS: Laws[ScanTests] = dict.fromkeys(
    (
        answers_with_numbers,
        same_input_same_answer,
        poses_and_scan_not_changed,
        each_pose_by_itself,
        global_rng_untouched,
        the_truth_is_likelier,
    )
)
