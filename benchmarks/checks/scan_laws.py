"""The laws that every scan model keeps: ``deqmcl check NAME --scan`` tries them in a world."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.checks import asked, require, tried
from benchmarks.setup.changes import Changes
from benchmarks.setup.names import absolute_scenario
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.numerics.types import Singles
from deqmcl_gym.validation import InputError
from localizers import UniformPrior, absolute_name
from localizers.checks.laws import Verdict
from localizers.checks.randomness import global_states
from localizers.models.scan import Scan, ScanModel
from localizers.scan_plug_in import SCAN_MODEL, is_code, scan_name

WORLDS = ("sharp", "lost")  # the first that a model does not refuse is the one it is tried in
FREE, ANYWHERE = 200, 100  # poses that a scan is held against; the last on and around the map
SCANS = 100
# Of a model for which the truth is likelier than another pose in three scans of four, fewer than 60
# of 100 have a probability below 0.001 (binomial).
FEWEST = 60
_CLOSE = 1e-4  # of log-likelihoods: a sum in another order, as BLAS makes it for other sizes


@dataclass(frozen=True)
class Scans:
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

    @cached_property
    def _poses(self) -> Singles:
        robot, rng = self._stage.robot, np.random.default_rng(0)
        prior = UniformPrior(floor_plan=robot.floor_plan, radius=robot.radius)
        free = prior.sample(FREE, rng)
        low, high = free.min(axis=0), free.max(axis=0)
        anywhere = rng.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low), (ANYWHERE, 3))
        return np.ascontiguousarray(np.vstack([free, anywhere]).T, np.float32)

    def scan(self, number: int, missing: float = 0.0) -> Scan:
        """Return what the lidar measures at a free pose, with a share of the beams missing."""
        robot, rng = self._stage.robot, np.random.default_rng((1, number))
        sigma = self._stage.scenario.world.lidar.sigma
        ranges = robot.lidar.ranges(robot.floor_plan, self._poses[:, number : number + 1])[0]
        ranges = np.abs(ranges + sigma * rng.standard_normal(ranges.size))
        ranges[rng.random(ranges.size) < missing] = np.nan
        return Scan.of(np.asarray(ranges, np.float64), robot.lidar.max_range)

    def begun(self) -> None:
        """Make the model."""
        self.model()

    @cached_property
    def _stage(self) -> Stage:
        trial = Trial(
            scenario=self.scenario,
            assumed=Changes({"scan.kind": self.kind}),
            localizer="mcl",
            params=Changes({"particles": 50}),
            lag=0,
            seed=0,
            trial=0,
        )
        return Stage.of(trial)


def answers_in_time(scans: Scans) -> None:
    """It answers with (n,) numbers, finite or -inf, within the time limit."""
    model = scans.model()
    for number in range(10):
        model.log_likelihood(scans.poses, scans.scan(number))


def answers_without_some_beams(scans: Scans) -> None:
    """It answers as well where half of the beams measured nothing."""
    model = scans.model()
    for number in range(10):
        model.log_likelihood(scans.poses, scans.scan(number, missing=0.5))


def same_input_same_answer(scans: Scans) -> None:
    """Two models, made anew, answer alike, and so does one that has seen other scans."""
    model = scans.model()
    first = model.log_likelihood(scans.poses, scans.scan(0))
    model.log_likelihood(scans.poses, scans.scan(1))
    again = model.log_likelihood(scans.poses, scans.scan(0))
    anew = scans.model().log_likelihood(scans.poses, scans.scan(0))
    require(np.array_equal(first, again), "it answers otherwise after another scan")
    require(np.array_equal(first, anew), "made anew, it answers otherwise")


def inputs_not_changed(scans: Scans) -> None:
    """It writes neither into the poses nor into the scan."""
    scan, poses = scans.scan(0), scans.poses
    ranges, usable = scan.ranges.copy(), scan.usable.copy()
    scans.model().log_likelihood(poses, scan)
    require(np.array_equal(poses, scans.poses), "it changed the poses: make a copy")
    same = np.array_equal(ranges, scan.ranges, equal_nan=True)
    require(same and np.array_equal(usable, scan.usable), "it changed the scan: make a copy")


def each_pose_by_itself(scans: Scans) -> None:
    """What it says of a pose does not depend on the other poses, nor on their order."""
    model, scan = scans.model(), scans.scan(0)
    order = np.random.default_rng(2).permutation(scans.poses.shape[1])
    whole = model.log_likelihood(scans.poses, scan)
    for some in (order, order[:7]):
        own = model.log_likelihood(np.ascontiguousarray(scans.poses[:, some]), scan)
        alike = np.allclose(own, whole[some], rtol=_CLOSE, atol=_CLOSE)
        require(alike, f"it says otherwise of the same poses in a batch of {some.size}")


def global_rng_untouched(scans: Scans) -> None:
    """It neither seeds nor draws from the global generators of NumPy and Python."""
    before = global_states()
    scans.model().log_likelihood(scans.poses, scans.scan(0))
    require(global_states() == before, "it used a global generator: make one of your own")


def the_truth_is_likelier(scans: Scans) -> None:
    """The pose of a scan is mostly likelier than another free pose."""
    model, likelier = scans.model(), 0
    for number in range(SCANS):
        two = np.ascontiguousarray(scans.poses[:, [number, (number + SCANS) % FREE]])
        truth, other = model.log_likelihood(two, scans.scan(number))
        likelier += bool(truth > other)
    require(
        likelier >= FEWEST,
        f"the truth is likelier than another free pose in {likelier} of {SCANS} scans, but must be "
        f"in {FEWEST}",
    )


LAWS: tuple[Callable[[Scans], None], ...] = (
    answers_in_time,
    answers_without_some_beams,
    same_input_same_answer,
    inputs_not_changed,
    each_pose_by_itself,
    global_rng_untouched,
    the_truth_is_likelier,
)


def verdicts(name: str, scenario: str | None = None, *, timeout: float = 60.0) -> Iterator[Verdict]:
    """Try a scan model against all laws, one after the other; a plug-in in processes of its own.

    Args:
        name: of a built-in kind, or ``file.py:NAME`` as in ``assumed.scan.kind``.
        scenario: whose map and lidar it is made for; by default the first of ``WORLDS`` that it
            does not refuse.
        timeout: s that a law may take.

    Raises:
        InputError: there is no such scan model, or it refuses every world.
    """
    foreign = is_code(name)
    kind = absolute_name(SCAN_MODEL.complete(name)) if foreign else name
    worlds = WORLDS if scenario is None else (absolute_scenario(scenario),)
    scans = asked(foreign, timeout, _world_of, kind, worlds)
    yield from tried(LAWS, scans, scan_name(kind), foreign=foreign, timeout=timeout)


def _world_of(kind: str, worlds: tuple[str, ...]) -> Scans:
    for world in worlds:
        try:
            Scans(kind, world).begun()
        except InputError as error:
            refusal = error
            continue
        return Scans(kind, world)
    raise refusal
