"""The laws of agents, on a short drive, and of scan models, in the form of localizers.checks."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from types import SimpleNamespace
from typing import Any, ClassVar, Self

import numpy as np

from benchmarks.setup import Agent
from benchmarks.setup.names import AGENT, absolute_reference, absolute_scenario, make_agent
from benchmarks.setup.overrides import Named, Overrides
from benchmarks.trials import Trial
from benchmarks.trials.episode import moments
from benchmarks.trials.stage import Stage
from deqmcl_gym.maps import GridMap
from deqmcl_gym.numerics import Reals, Singles
from deqmcl_gym.validation import InputError, array
from localizers import Belief, UniformPrior, make
from localizers.checks import Report, laws, report_of
from localizers.checks.subject import LawBrokenError, Subject, difference, localizer_drive, robot_on
from localizers.kinds import Kind
from localizers.models.scan import Scan, ScanModel
from localizers.registry import SCAN_MODEL

_STEPS = 40
FREE, ANYWHERE = 200, 100  # poses that a scan is held against; the last on and around the map
_SCANS = 100
# Of a model for which the truth is likelier than another pose in three scans of four, fewer than 60
# of 100 have a probability below 0.001 (binomial).
FEWEST = 60
_CLOSE = 1e-4  # of log-likelihoods: a sum in another order, as BLAS makes it for other sizes
_FEW = Overrides({"particles": 50})
_TRIAL = Trial(scenario="", localizer="mcl-map", params=_FEW, lag=0, seed=0, trial=0)
_NOWHERE = SimpleNamespace(points=lambda offset=0: (np.empty((0, 3)), np.empty(0)))

Answer = tuple[Reals, Reals | None]


@dataclass(frozen=True, kw_only=True)
class _InAScenario(Subject):
    """What is made for a scenario, by default for the first of ``worlds`` that it accepts."""

    kind: ClassVar[Kind]
    worlds: ClassVar[tuple[str, ...]]
    scenario: str

    @classmethod
    def of(cls, name: str, scenario: str | None) -> Self:
        for world in cls.worlds if scenario is None else (absolute_scenario(scenario),):
            subject = cls(name=absolute_reference(cls.kind, name), scenario=world)
            try:
                subject.begin()
            except InputError as error:
                refusal = error
                continue
            except Exception:  # a law will say so
                pass
            return subject
        raise refusal

    def begin(self) -> object:
        raise NotImplementedError


class _Watched:
    """An agent whose answers and inputs are looked at; if blind, it is shown an empty belief."""

    def __init__(self, agent: Agent, *, blind: bool) -> None:
        self._agent, self._blind = agent, blind
        self.sees_truth = getattr(agent, "sees_truth", False)
        self.answers: list[Answer] = []
        self.written: str | None = None  # into what

    def plan_at_reset(self, info: dict[str, Any]) -> Reals | None:
        before = deepcopy({"info": info})
        plan = self._agent.plan_at_reset(info)
        self.written = difference(before, {"info": info})
        return plan

    def act(self, belief: Belief, info: dict[str, Any]) -> Answer:
        shown: Any = _NOWHERE if self._blind else belief
        before = deepcopy({"the belief": shown.points(), "info": info})
        answer = self._agent.act(shown, info)
        after = {"the belief": shown.points(), "info": info}
        self.written = self.written or difference(before, after)
        self.answers.append(deepcopy(answer))
        return answer


class AgentDrive(_InAScenario):
    """An agent in a world."""

    remedy = (
        "draw random numbers from numpy.random.default_rng of what it is shown, as of "
        "info['truth'] or info['route']"
    )
    kind, worlds = AGENT, ("guided", "driving")

    def begin(self) -> object:
        """Take no more than the first step."""
        return self.watched(0)

    def history(self) -> list[Answer]:
        return self.watched().answers

    def written(self) -> str | None:
        return self.watched().written

    def watched(self, steps: int = _STEPS, *, blind: bool = False) -> _Watched:
        """Return an agent, made anew, after the drive; all that a blind one sees is empty."""
        stage = Stage.of(replace(_TRIAL, scenario=self.scenario, agent=Named(self.name)))
        agent = _Watched(make_agent(self.name, stage.robot), blind=blind)
        localizer = make("mcl-map", stage.robot, **_FEW)
        rng, seed = np.random.default_rng(0), stage.trial.world_seed
        drive = moments(stage.env, agent, localizer, stage.prior, rng, seed=seed)
        for _ in islice(drive, steps + 1):
            pass
        return agent


def answers_with_actions(drive: AgentDrive, *, blind: bool = False) -> None:
    """At every step an action is two finite numbers; a plan is None or finite rows (h, 2)."""
    for step, (action, plan) in enumerate(drive.watched(blind=blind).answers):
        at = f"at step {step}{' on an empty belief' * blind}"
        try:
            array(f"its action {at}", action, (2,))
            if plan is not None:
                array(f"its plan {at}", plan, (None, 2))
        except InputError as error:
            raise LawBrokenError(str(error).rstrip(".")) from None


def survives_an_empty_belief(drive: AgentDrive) -> None:
    """It answers so to a belief without points, too."""
    answers_with_actions(drive, blind=True)


class ScanTests(_InAScenario):
    """A scan model in a world, with poses and scans to try it on."""

    remedy = "make a generator of your own"
    kind, worlds = SCAN_MODEL, ("sharp", "lost")

    def begin(self) -> ScanModel:
        return self._stage.robot.scan_model()

    def history(self) -> list[Reals]:
        """Return what a model, made anew, says of a scan, of another one, and of the first."""
        model = self.begin()
        return [model.log_likelihood(self.poses, self.scan(number)) for number in (0, 1, 0)]

    def written(self) -> str | None:
        poses, scan = self.poses, self.scan(0)
        before = deepcopy({"the poses": poses, "the scan": scan})
        self.begin().log_likelihood(poses, scan)
        return difference(before, {"the poses": poses, "the scan": scan})

    @property
    def poses(self) -> Singles:
        """Poses as rows x, y, θ, free ones first, (3, n); a copy, as a model may write into it."""
        return self._poses.copy()

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
        assumed = Overrides({"scan.kind": self.name})
        return Stage.of(replace(_TRIAL, scenario=self.scenario, assumed=assumed))


def answers_with_numbers(scans: ScanTests) -> None:
    """It answers with (n,) numbers, finite or -inf, also where half of the beams are missing."""
    model = scans.begin()
    for number in range(10):
        for missing in (0.0, 0.5):
            model.log_likelihood(scans.poses, scans.scan(number, missing))


def same_input_same_answer(scans: ScanTests) -> None:
    """Two models, made anew, answer alike, and so does one that has seen other scans."""
    first, _, again = scans.history()
    if not np.array_equal(first, again):
        raise LawBrokenError("it answers otherwise after another scan")
    if not np.array_equal(first, scans.history()[0]):
        raise LawBrokenError("made anew, it answers otherwise")


def each_pose_by_itself(scans: ScanTests) -> None:
    """What it says of a pose does not depend on the other poses, nor on their order."""
    model, whole = scans.begin(), scans.history()[0]
    order = np.random.default_rng(2).permutation(FREE + ANYWHERE)
    for some in (order, order[:7]):
        poses = np.ascontiguousarray(scans.poses[:, some])
        likelihoods = model.log_likelihood(poses, scans.scan(0))
        if not np.allclose(likelihoods, whole[some], rtol=_CLOSE, atol=_CLOSE):
            raise LawBrokenError(f"it says otherwise of the same poses in a batch of {some.size}")


def the_truth_is_likelier(scans: ScanTests) -> None:
    """The pose of a scan is mostly likelier than another free pose."""
    model, likelier = scans.begin(), 0
    for number in range(_SCANS):
        two = np.ascontiguousarray(scans.poses[:, [number, (number + _SCANS) % FREE]])
        truth, other = model.log_likelihood(two, scans.scan(number))
        likelier += bool(truth > other)
    if likelier < FEWEST:
        raise LawBrokenError(
            f"the truth is likelier than another free pose in {likelier} of {_SCANS} scans, but "
            f"must be in {FEWEST}"
        )


def _localizer(name: str, map_file: str | None) -> Subject:
    return localizer_drive(name, None if map_file is None else robot_on(GridMap.load(map_file)))


def _laws(first: laws.Law, second: laws.Law, *last: laws.Law) -> laws.Laws:
    rest = first, second, laws.inputs_not_changed, laws.global_rng_untouched, *last
    return {laws.answers_in_time: None, **dict.fromkeys(rest, laws.answers_in_time)}


_OF_AGENTS = _laws(answers_with_actions, laws.same_rng_same_result, survives_an_empty_belief)
_OF_SCANS = _laws(
    answers_with_numbers, same_input_same_answer, each_pose_by_itself, the_truth_is_likelier
)
# how what is under check is made, of its name and a map or a scenario, and its laws
KINDS: dict[str, tuple[Callable[[str, str | None], Subject], laws.Laws]] = {
    "localizers": (_localizer, laws.LAWS),
    "agents": (AgentDrive.of, _OF_AGENTS),
    "scan models": (ScanTests.of, _OF_SCANS),
}


def check(kind: str, name: str, where: str | None = None) -> Report:
    """Return the verdicts of all laws of a kind on what a name leads to, tried in this process."""
    build, laws_of_kind = KINDS[kind]
    return report_of(build(name, where), laws_of_kind)
