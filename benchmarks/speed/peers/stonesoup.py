"""MCL by Stone Soup (Dstl): a particle predictor and updater on models of our own."""

import datetime
from collections.abc import Callable

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement import MeasurementModel
from stonesoup.models.transition import TransitionModel
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import ParticleState, State
from stonesoup.updater.particle import ParticleUpdater

from benchmarks.speed.numpy_baseline import Cloud, NumpyModels
from deqmcl_gym.numerics.types import Reals
from localizers import Prior, RobotModel

_STEP = datetime.timedelta(seconds=1)


class _Motion(TransitionModel):
    models: NumpyModels = Property()
    rng: np.random.Generator = Property()
    action: Reals = Property(default=None)
    ndim_state = 3
    rvs = pdf = None  # required, but a particle filter asks for neither

    def function(self, state: State, noise: bool = False, **_: object) -> StateVectors:
        cloud = np.asarray(state.state_vector, dtype=np.float32)
        return self.models.moved(cloud, self.action, self.rng).view(StateVectors)


class _Scan(MeasurementModel):
    models: NumpyModels = Property()
    function = rvs = pdf = None  # required, but a particle filter asks for none of them

    @property
    def ndim_meas(self) -> int:
        return self.models.robot.lidar.beams

    def logpdf(self, state1: State, state2: State, **_: object) -> Reals:
        cloud = np.asarray(state2.state_vector, dtype=np.float32)
        return self.models.log_likelihood(cloud, np.asarray(state1.state_vector)[:, 0])


def mcl(
    robot: RobotModel, particles: int, prior: Prior, rng: np.random.Generator
) -> Callable[..., Cloud]:
    """Return ``update`` of MCL, which resamples at the end of a step as its updater does."""
    models = NumpyModels(robot)
    motion = _Motion(models=models, rng=rng)
    predictor = ParticlePredictor(motion)
    model = _Scan(ndim_state=3, mapping=(0, 1, 2), models=models)
    updater = ParticleUpdater(model, resampler=SystematicResampler())
    state = ParticleState(
        StateVectors(prior.sample(particles, rng).T),
        weight=np.full(particles, 1 / particles),
        timestamp=datetime.datetime(2000, 1, 1),
    )

    def update(scan: Reals, action: Reals, *_: object) -> Cloud:
        nonlocal state
        motion.action = action
        now = state.timestamp + _STEP
        predicted = predictor.predict(state, timestamp=now)
        seen = Detection(StateVector(scan), timestamp=now)
        state = updater.update(SingleHypothesis(predicted, seen))
        return np.asarray(state.state_vector).T, np.exp(np.asarray(state.log_weight))

    return update
