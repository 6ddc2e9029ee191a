"""One trial, watched step by step: truth, scan, plan, belief, and a picture of each."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.experiment import known, methods_of, plain
from benchmarks.pictures.figures import camera_of
from benchmarks.pictures.film import Camera
from benchmarks.setup.changes import Changes
from benchmarks.sweeps.design import Sweep
from benchmarks.trials.episode import Step
from benchmarks.trials.stage import Stage
from deqmcl_gym.validation import integer
from localizers.registry import Factory


def run(
    scenario: str, localizer: str | Factory, *, seed: int = 0, trial: int = 0, **params: Any
) -> Iterator[Step]:
    """Run one trial, and yield it step by step.

    Args:
        scenario: as in ``sweep``.
        localizer: a name, or what makes a localizer for a robot.
        seed, trial: the world is that of this trial of a sweep with this seed.
        params: of the localizer.

    Raises:
        InputError: an unknown name, or a bad value.
    """
    (method,), factories = methods_of([localizer])
    integer("trial", trial)
    with known(factories):
        of = Sweep(
            title=scenario,
            scenario=scenario,
            localizers=(replace(method, params=method.params | Changes(plain(params))),),
            seed=seed,
            trials=trial + 1,
        )
        stage = Stage.of(of.distinct()[trial])
        camera, name = camera_of(stage), str(of.localizers[0])
        for step in stage.moments():
            yield step._replace(draw=partial(_picture, camera, step, name))


def _picture(camera: Camera, step: Step, method: str) -> NDArray[np.uint8]:
    return np.ascontiguousarray(camera.frame(step, [f"{method}, t = {step.t}"]))
