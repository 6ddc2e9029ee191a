"""MCL by Stone Soup (Dstl): a particle predictor and updater on models of our own."""

import datetime

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

    @property
    def ndim_state(self) -> int:
        return 3

    def function(self, state: State, noise: bool = False, **_: object) -> StateVectors:
        cloud = np.asarray(state.state_vector, dtype=np.float32)
        return self.models.moved(cloud, self.action, self.rng).view(StateVectors)

    def rvs(self, *_: object, **__: object) -> None:
        raise NotImplementedError

    def pdf(self, *_: object, **__: object) -> None:
        raise NotImplementedError


class _Scan(MeasurementModel):
    models: NumpyModels = Property()

    @property
    def ndim_meas(self) -> int:
        return self.models.robot.lidar.beams

    def function(self, *_: object, **__: object) -> None:
        raise NotImplementedError

    def rvs(self, *_: object, **__: object) -> None:
        raise NotImplementedError

    def pdf(self, *_: object, **__: object) -> None:
        raise NotImplementedError

    def logpdf(self, state1: State, state2: State, **_: object) -> Reals:
        cloud = np.asarray(state2.state_vector, dtype=np.float32)
        return self.models.log_likelihood(cloud, np.asarray(state1.state_vector)[:, 0])


class StoneSoupMCL:
    """MCL; systematic resampling at the end of every step, as Stone Soup's updater does."""

    def __init__(self, robot: RobotModel, *, particles: int) -> None:
        """Make MCL for a robot."""
        self._models, self._particles = NumpyModels(robot), particles

    def reset(self, prior: Prior, plan: Reals, rng: np.random.Generator) -> Cloud:
        """Start anew."""
        del plan
        self._motion = _Motion(models=self._models, rng=rng)
        self._predictor = ParticlePredictor(self._motion)
        scan = _Scan(ndim_state=3, mapping=(0, 1, 2), models=self._models)
        self._updater = ParticleUpdater(scan, resampler=SystematicResampler())
        n = self._particles
        self._state = ParticleState(
            StateVectors(prior.sample(n, rng).T),
            weight=np.full(n, 1 / n),
            timestamp=datetime.datetime(2000, 1, 1),
        )
        return self._belief()

    def update(self, ranges: Reals, action: Reals, plan: Reals) -> Cloud:
        """Go one step on."""
        del plan
        self._motion.action = action
        now = self._state.timestamp + _STEP
        predicted = self._predictor.predict(self._state, timestamp=now)
        seen = Detection(StateVector(ranges), timestamp=now)
        self._state = self._updater.update(SingleHypothesis(predicted, seen))
        return self._belief()

    def _belief(self) -> Cloud:
        return Cloud(
            np.asarray(self._state.state_vector).T, np.exp(np.asarray(self._state.log_weight))
        )
