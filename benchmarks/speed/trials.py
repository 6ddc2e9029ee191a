"""A whole trial against its localizer alone, and a localizer's step under other scans."""

from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.speed.figure import MICROSECONDS, Figure, Sides
from benchmarks.speed.lap import BEAMS, RecordedLap, recorded_lap
from benchmarks.speed.steps import FEW
from benchmarks.speed.timing import Job
from benchmarks.trials.attempt import attempt
from benchmarks.trials.plugins import key_of
from benchmarks.trials.spec import Trial
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.numerics.types import Reals
from localizers import CensoredGaussianUniform, GaussianPrior, RobotModel, make

SIGMA = 100.0  # px
BELUGA = 383.0  # µs: what is said of its likelihood field with KLD-sampling and as many particles


def trial_sides(name: str) -> Sides:
    """Return a whole trial of the paper's scenario, and the localizer's part of it."""
    trial = Trial(
        scenario="paper", localizer=name, params=(("particles", FEW),), lag=20, seed=0, trial=0
    )
    key = key_of(trial)
    room = RoomEnv(preset="paper", ends_at_goal=False)
    room.reset(seed=trial.world_seed)
    plan = room.plan.astype(np.float64)
    scans = [room.step(action)[0] for action in plan]
    robot = RobotModel(floor_plan=room.floor_plan, lidar=room.lidar)
    prior = GaussianPrior(mean=room.course.start)

    def localize() -> None:
        localizer = make(name, robot, particles=FEW)
        localizer.reset(prior, plan, trial.filter_rng())
        for t, (scan, action) in enumerate(zip(scans, plan, strict=True), start=1):
            localizer.update(scan, action, plan[t:])

    whole = Job(call=lambda: attempt(trial, key), amount=len(plan))
    return whole, Job(call=localize, amount=len(plan))


def _under(lap: RecordedLap, scans: Reals) -> Job:
    robot = replace(lap.robot, scan=CensoredGaussianUniform(sigma=SIGMA))
    return replace(lap, robot=robot, scans=scans).following(make("mcl", robot, particles=FEW))


def censored_sides(beams: int) -> Sides:
    """Return MCL's step where every other beam is clipped at the maximum, and where none is."""
    lap = recorded_lap(beams)
    inside = np.clip(lap.scans, 1.0, lap.robot.lidar.max_range - 1.0)
    clipped = inside.copy()
    clipped[:, ::2] = lap.robot.lidar.max_range
    return _under(lap, clipped), _under(lap, inside)


def amcl_sides(beams: int) -> Sides:
    """Return the step of AMCL with KLD-sampling, and the time that is said of beluga's."""
    lap = recorded_lap(beams)
    return lap.following(make("amcl", lap.robot, min_particles=FEW, max_particles=FEW)), BELUGA


FIGURES = (
    *(
        Figure(
            name=f"trial_{name.replace('-', '_')}",
            task=f"whole trial, scenario paper, N = {FEW:,}",
            ours=f"{name}, run and scored",
            other="its localizer alone",
            unit=MICROSECONDS,
            target=2,
            sides=partial(trial_sides, name),
        )
        for name in ("mcl", "deq-mcl")
    ),
    *(
        Figure(
            name=f"censored_vs_inside_{beams}",
            task=f"MCL step, N = {FEW:,}, B = {beams}, censored normal",
            ours="every other beam clipped",
            other="none clipped",
            unit=MICROSECONDS,
            target=1.5,
            sides=partial(censored_sides, beams),
        )
        for beams in (1, BEAMS)
    ),
    Figure(
        name="amcl_step",
        task=f"AMCL step, likelihood field, KLD, N = {FEW:,}, B = {BEAMS}",
        ours="amcl",
        other="beluga, on another machine, not measured here",
        unit=MICROSECONDS,
        target=1,
        sides=partial(amcl_sides, BEAMS),
    ),
)
