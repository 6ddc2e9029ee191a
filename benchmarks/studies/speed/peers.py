"""Other packages at the same work, written as their users would; imported where they are used.

A caster, made for a map and a number of beams, casts a fan of beams, from -π against the heading
on, at one pose. A filter, made for a robot, particles, a prior and a generator, is ``update`` of
MCL, which resamples systematically at every step; it is given our NumPy models
(``numpy_baseline``), so that what differs is the filter.
"""

import datetime
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.speed.numpy_baseline import Cloud, NumpyModels
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.numerics.types import Reals
from localizers import Prior, RobotModel

_FAR = 1000.0  # px, beyond every wall
_STEP = datetime.timedelta(seconds=1)

CasterMaker = Callable[[PolygonMap, int], Callable[[Sequence[float]], Any]]
Update = Callable[..., Cloud]


def navground(floor_plan: PolygonMap, beams: int) -> Callable[[Sequence[float]], list[float]]:
    """Return navground's caster (C++): exact distances to line segments, (beams,) px."""
    from navground.core import CollisionComputation, LineSegment, Pose2

    walls = [LineSegment(wall[:2], wall[2:]) for wall in floor_plan.walls]
    computation = CollisionComputation()
    length = 2 * math.pi * (1 - 1 / beams)

    def ranges(pose: Sequence[float]) -> list[float]:
        x, y, heading = pose
        computation.setup(Pose2((x, y), heading), 0.0, walls)
        seen: list[float] = computation.get_free_distance_for_sector(
            heading - math.pi, length, beams - 1, _FAR, False
        )
        return seen

    return ranges


def raycast2d(
    floor_plan: PolygonMap, beams: int
) -> Callable[[Sequence[float]], NDArray[np.uint32]]:
    """Return raycast2D's caster (C), Bresenham lines through an image of the map.

    It gives the pixels (column, row), of 1 px, that beams hit, (beams, 2).
    """
    from raycast2D import Lidar2D

    x0, y0, x1, y1 = floor_plan.bounds
    rows, columns = np.mgrid[: math.ceil(y1 - y0), : math.ceil(x1 - x0)]
    centres = np.column_stack([columns.ravel() + x0 + 0.5, rows.ravel() + y0 + 0.5])
    image = floor_plan.free(centres).reshape(rows.shape).astype(np.uint8)
    lidar = Lidar2D(num_rays=beams, FOV=360 - 360 / beams, ray_length=500, occupancy_grid=image)
    # it turns a fan of 360° - 360°/beams to both sides alike, from 90° against the x axis
    turn = math.pi / 2 - math.pi / beams

    def hits(pose: Sequence[float]) -> NDArray[np.uint32]:
        x, y, heading = pose
        seen: NDArray[np.uint32] = lidar.scan(
            (int(x - x0), int(y - y0), heading + turn), only_true_collisions=False
        )
        return seen

    return hits


def particles(robot: RobotModel, count: int, prior: Prior, rng: np.random.Generator) -> Update:
    """Return MCL by ``particles`` (Chopin & Papaspiliopoulos): a Feynman-Kac model and its loop."""
    import particles as library

    models = NumpyModels(robot)
    told: dict[str, Reals] = {}  # action and scan of the step

    class Localization(library.FeynmanKac):
        """The bootstrap filter's model."""

        def M0(self, N: int) -> Reals:  # noqa: N802, N803 (the names are the library's)
            return prior.sample(N, rng).astype(np.float32)

        def M(self, t: int, xp: Reals) -> Reals:  # noqa: N802
            return models.moved(xp.T, told["action"], rng).T

        def logG(self, t: int, xp: Reals, x: Reals) -> Reals:  # noqa: N802
            return models.log_likelihood(x.T, told["scan"]) if told else np.zeros(len(x))

    model = Localization(10**9)  # steps: for ever
    smc = library.SMC(fk=model, N=count, resampling="systematic", ESSrmin=2.0, collect="off")
    next(smc)

    def update(scan: Reals, action: Reals, *_: object) -> Cloud:
        told.update(scan=scan, action=action)
        next(smc)
        return smc.X, smc.W

    return update


def pfilter(robot: RobotModel, count: int, prior: Prior, rng: np.random.Generator) -> Update:
    """Return MCL by ``pfilter`` (Williamson): functions for dynamics, observation and weight."""
    from pfilter import ParticleFilter, systematic_resample

    models = NumpyModels(robot)

    def weight(particles: Reals, scan: Reals, **_: Any) -> Reals:
        log_likelihood = models.log_likelihood(particles.T, scan[0])
        relative: Reals = np.exp(log_likelihood - log_likelihood.max())
        return relative

    filtering = ParticleFilter(
        prior_fn=lambda n: prior.sample(n, rng).astype(np.float32),
        n_particles=count,
        observe_fn=lambda particles, **_: particles,
        dynamics_fn=lambda particles, *, action, **_: models.moved(particles.T, action, rng).T,
        noise_fn=lambda particles, **_: particles,
        weight_fn=weight,
        resample_fn=systematic_resample,
        n_eff_threshold=2.0,
    )

    def update(scan: Reals, action: Reals, *_: object) -> Cloud:
        with np.errstate(divide="ignore", invalid="ignore"):  # its entropy of weights that are 0
            filtering.update(scan, action=action)
        return filtering.original_particles, filtering.original_weights

    return update


def stonesoup(robot: RobotModel, count: int, prior: Prior, rng: np.random.Generator) -> Update:
    """Return MCL by Stone Soup (Dstl), which resamples at the end of a step as its updater does."""
    from stonesoup.models.measurement import MeasurementModel
    from stonesoup.models.transition import TransitionModel
    from stonesoup.predictor.particle import ParticlePredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVector, StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import ParticleState, State
    from stonesoup.updater.particle import ParticleUpdater

    models = NumpyModels(robot)
    driven: Reals = np.zeros(2)

    class Motion(TransitionModel):
        ndim_state = 3
        rvs = pdf = None  # required, but a particle filter asks for neither

        def function(self, state: State, noise: bool = False, **_: object) -> StateVectors:
            cloud = np.asarray(state.state_vector, dtype=np.float32)
            return models.moved(cloud, driven, rng).view(StateVectors)

    class Scan(MeasurementModel):
        ndim_meas = robot.lidar.beams
        function = rvs = pdf = None  # required, but a particle filter asks for none of them

        def logpdf(self, state1: State, state2: State, **_: object) -> Reals:
            cloud = np.asarray(state2.state_vector, dtype=np.float32)
            return models.log_likelihood(cloud, np.asarray(state1.state_vector)[:, 0])

    predictor = ParticlePredictor(Motion())
    model = Scan(ndim_state=3, mapping=(0, 1, 2))
    updater = ParticleUpdater(model, resampler=SystematicResampler())
    state = ParticleState(
        StateVectors(prior.sample(count, rng).T),
        weight=np.full(count, 1 / count),
        timestamp=datetime.datetime(2000, 1, 1),
    )

    def update(scan: Reals, action: Reals, *_: object) -> Cloud:
        nonlocal state, driven
        driven = action
        now = state.timestamp + _STEP
        predicted = predictor.predict(state, timestamp=now)
        seen = Detection(StateVector(scan), timestamp=now)
        state = updater.update(SingleHypothesis(predicted, seen))
        return np.asarray(state.state_vector).T, np.exp(np.asarray(state.log_weight))

    return update
