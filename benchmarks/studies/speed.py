"""Our speed: rays, filter steps, trials and environment steps, as ratios to others in the same run.

``python -m benchmarks.studies.speed [--quick] --out DIR`` prints the figures and writes speed.csv;
docs/speed.md says what is compared. It is of this repository, not of the package.
"""

import argparse
import math
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from statistics import median
from timeit import Timer
from typing import Any, NamedTuple
from unittest.mock import patch

from benchmarks.execution import ONE_THREAD

if __name__ == "__main__":
    os.environ.update(ONE_THREAD)  # read by the libraries when they are loaded, below

import gymnasium as gym
import numpy as np
import pandas as pd
from tqdm import tqdm

import benchmarks
from benchmarks.sweeps import Sweep
from benchmarks.trials import Method, Trial
from benchmarks.trials.scoring import Finished
from benchmarks.trials.stage import Stage
from deqmcl_gym import ENV_ID as ROOM
from deqmcl_gym.maps import Lidar, Map, PolygonMap
from deqmcl_gym.numerics import Singles
from deqmcl_gym.world import PAPER_ROOM
from localizers import make

BEAMS, POSES = 16, 20_000
N_10K = 10_000  # particles
LIDAR = Lidar(beams=BEAMS, field_of_view=2 * math.pi, max_range=400.0, sigma=10.0)
BEARINGS = LIDAR.bearings.astype(np.float32)
PLANNED = 100  # actions that a localizer is shown: the mean over a lap that counts down
FEW_WORLDS = 20  # of a sweep; a larger one has more
RUNS = 3  # of a localizer on each world, as in ``plan-sensor``
FAN: dict[str, Any] = {"lidar": {"beams": BEAMS}}


class Effort(NamedTuple):
    """How often each job has its turn, the seconds that a turn takes at least, worlds of trials."""

    turns: int
    seconds: float
    worlds: int = 20


class Job(NamedTuple):
    """Work that can be done again and again: ``amount`` units a call, by a clock of seconds."""

    call: Callable[[], object]
    amount: float = 1.0
    clock: Callable[[], float] = time.process_time


class Ratio(NamedTuple):
    """A rate of ours, or with a unit of time a time, beside another's."""

    name: str
    unit: str
    sides: Callable[[Effort], Sequence[float]]  # measures ours and the other's
    package: str = ""  # that the other needs: the name of its module and that to install it by


def beside(
    name: str, unit: str, ours: Callable[[], Job], other: Callable[[], Job], package: str = ""
) -> Ratio:
    """Return the ratio of two jobs: they take turns; the median of its turns is that of a job."""

    def sides(effort: Effort) -> list[float]:
        jobs = ours(), other()
        timers = [Timer(job.call, timer=job.clock) for job in jobs]
        for timer in timers:
            timer.timeit(1)  # may compile
        calls = [max(1, round(n * effort.seconds / s)) for n, s in map(Timer.autorange, timers)]
        each = list(zip(jobs, timers, calls, strict=True))
        turns = [
            [job.amount * n / timer.timeit(n) for job, timer, n in each]
            for _ in range(effort.turns)
        ]
        rates = [median(side) for side in zip(*turns, strict=True)]
        return [1e6 / rate for rate in rates] if unit == "µs/step" else rates

    return Ratio(name, unit, sides, package)


def trial_beside(name: str, localizer: str, scenario: str = "paper", lag: int = 20) -> Ratio:
    """Return the CPU time of a trial as a sweep runs it, beside that of the localizer in it.

    That is a sweep of many worlds less one of few, for each of the worlds that it lacks.
    """

    def swept(worlds: int) -> tuple[float, Sequence[Finished]]:
        sweep = Sweep(
            title=name, scenario=scenario, localizers=(Method(localizer),), baseline=localizer,
            lag=lag, trials=worlds, filter_seeds=RUNS,
        )  # fmt: skip
        start = time.perf_counter()
        results = benchmarks.sweep(sweep).run(jobs=1, progress=False).results
        return time.perf_counter() - start, results.records

    def sides(effort: Effort) -> list[float]:
        with patch.object(time, "perf_counter", time.process_time):  # by which localizers are timed
            swept(2)  # compiles
            few, _ = swept(FEW_WORLDS)
            many, records = swept(FEW_WORLDS + effort.worlds)
        localizing = sum(r.seconds or math.nan for r in records if r.trial.trial >= FEW_WORLDS)
        return [1e3 * seconds / (RUNS * effort.worlds) for seconds in (many - few, localizing)]

    return Ratio(name, "ms/trial", sides)


def free_poses(floor_plan: Map, n: int) -> Singles:
    """Draw poses uniformly from free space, always the same ones, (n, 3)."""
    rng = np.random.default_rng(0)
    x0, y0, x1, y1 = floor_plan.bounds
    points = rng.uniform((x0, y0), (x1, y1), (20 * n, 2))
    free = points[floor_plan.free(points, radius=0.1)][:n]
    return np.column_stack([free, rng.uniform(-math.pi, math.pi, n)]).astype(np.float32)


def rays(cast: Callable[[PolygonMap, Singles], object]) -> Job:
    """Return the job of ranges all over the paper's room."""
    poses = free_poses(PAPER_ROOM, POSES)
    return Job(lambda: cast(PAPER_ROOM, poses), POSES * BEAMS)


def numpy_ranges(room: PolygonMap, poses: Singles) -> Singles:
    """Return ranges at poses (n, 3), (n, BEAMS) px, by NumPy: every ray and wall, in blocks."""
    out = np.empty((BEAMS, len(poses)), np.float32)
    for first in range(0, len(poses), 16_384 // BEAMS):
        block = slice(first, first + 16_384 // BEAMS)
        x, y, heading = np.ascontiguousarray(poses[block].T)
        dx, dy = np.cos(heading + BEARINGS[:, None]), np.sin(heading + BEARINGS[:, None])
        nearest = np.full(dx.shape, np.inf, np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            for x0, y0, x1, y1 in room.walls.astype(np.float32):
                ex, ey, rx, ry = x1 - x0, y1 - y0, x0 - x, y0 - y
                cross = dx * ey - dy * ex
                t, u = (rx * ey - ry * ex) / cross, (rx * dy - ry * dx) / cross
                t[(t < 0) | (u < 0) | (u > 1)] = np.inf
                np.fmin(nearest, t, out=nearest)  # parallel to the wall: NaN
        out[:, block] = nearest
    return out.T


@cache
def lap(scenario: str) -> tuple[Stage, list[tuple[Any, ...]]]:
    """Drive a lap: scan, action and plan by step, of step 0 those of ``reset``.

    The plan of ``guided`` is another one at every step, that of ``paper`` goes on and on, so that a
    queue only shifts.
    """
    fan = {"lidar.beams": BEAMS, "lidar.field_of_view": LIDAR.field_of_view, "lidar.sigma": 10.0}
    run: dict[str, Any] = {"localizer": "dead-reckoning", "params": {}, "lag": 0, "trial": 0}
    run |= {"world": fan if scenario == "paper" else {}, "seed": 0}
    stage = Stage.of(Trial(scenario=scenario, **run))
    steps = [(moment.ranges, moment.action, moment.plan) for moment in stage.moments()]
    if scenario == "paper":
        laps = np.tile(np.array(steps[0][2]), (2, 1))
        steps = [(*step[:2], laps[t : t + PLANNED]) for t, step in enumerate(steps)]
    return stage, steps


def filter_steps(name: str, particles: int, scenario: str = "paper", **params: int) -> Job:
    """Return the job of a step of one of our localizers on a lap, over and over, its queue full."""
    stage, (first, *steps) = lap(scenario)
    localizer = make(name, stage.robot, particles=particles, **params)
    numbers = count()

    def step() -> None:
        laps, t = divmod(next(numbers), len(steps))
        if t == 0 and (laps == 0 or scenario != "paper"):  # which ends where it starts
            localizer.reset(stage.prior(), first[2], np.random.default_rng(1))
        localizer.update(*steps[t])

    for _ in range(params.get("lag", 0)):
        step()
    return Job(step)


def env_steps() -> Job:
    """Return the job of one room along its plan, resets included."""
    env = gym.make(ROOM, **FAN)
    actions, at = env.reset(seed=0)[1]["planned_actions"].copy(), -1

    def step() -> None:
        nonlocal at
        at = (at + 1) % len(actions)
        *_, terminated, truncated, _ = env.step(actions[at])
        if terminated or truncated:
            env.reset()
            at = -1

    return Job(step)


def vector_parts(*, whole: bool, size: int = 64) -> Job:
    """Return the job of steps of rooms along their plans, or of what is neither rays nor driving.

    Steps that reset are left out.
    """
    envs: Any = gym.make_vec(ROOM, size, "vector_entry_point", **FAN)
    actions, at = gym.make(ROOM, **FAN).reset(seed=0)[1]["planned_actions"], np.full(size, -1)
    envs.reset(seed=0)
    rooms, spent = envs.unwrapped._rooms, {"step": 0.0, "move": 0.0, "cast": 0.0}

    def timed(of: Any, name: str) -> None:
        call = getattr(of, name)

        def timed_call(*arguments: Any) -> Any:
            start = time.process_time()
            result = call(*arguments)
            spent[name] += (time.process_time() - start) * bool((at >= 0).any())
            return result

        vars(of)[name] = timed_call

    for part, name in ((rooms, "move"), (rooms._rules.world.lidar, "cast"), (envs, "step")):
        timed(part, name)

    def step() -> None:
        nonlocal at
        at = (at + 1) % len(actions)
        *_, terminated, truncated, _ = envs.step(actions[at])
        at[terminated | truncated] = -2  # the next action only resets

    def clock() -> float:
        return spent["step"] - (0.0 if whole else spent["move"] + spent["cast"])

    return Job(step, clock=clock)


_CIRCLE = 0.2, 0.5  # m/s, rad/s of a robot below the obstacle of the paper's room
_START = 3.5, 0.6, 0.0  # m
_IN_METRES = [(0.02 * np.array(xy)).tolist() for xy in (PAPER_ROOM.outer, *PAPER_ROOM.obstacles)]


def ir_sim_steps() -> Job:
    """Return the job of a robot with the same lidar in the paper's room in IR-SIM."""
    import yaml

    irsim: Any = import_module("irsim")
    outer, inner = _IN_METRES
    walls = {"shape": {"name": "linestring", "vertices": [*outer, outer[0]]}, "state": [0, 0, 0]}
    solid = {"shape": {"name": "polygon", "vertices": inner}, "state": [0, 0, 0]}
    lidar = {"name": "lidar2d", "range_max": 8, "angle_range": 2 * math.pi, "number": BEAMS}
    robot = {
        "kinematics": {"name": "diff"}, "shape": {"name": "circle", "radius": 0.16},
        "state": list(_START), "goal": [100, 1, 0],
        "sensors": [lidar | {"range_min": 0, "noise": True, "std": 0.2}],
    }  # fmt: skip
    world = {"world": {"width": 7, "height": 6}, "robot": [robot], "obstacle": [walls, solid]}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "room.yaml"
        file.write_text(yaml.safe_dump(world))
        env = irsim.make(str(file), display=False, log_level="ERROR")

    def step() -> None:
        env.step(list(_CIRCLE))
        env.get_lidar_scan()

    return Job(step)


def navground_steps() -> Job:
    """Return the job of the same in navground; contacts are left out."""
    core: Any = import_module("navground.core")
    sim: Any = import_module("navground.sim")
    world, state = sim.World(), core.SensingState()
    for corners in _IN_METRES:
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
            world.add_wall(sim.Wall(core.LineSegment(start, end)))
    lidar = f"type: Lidar\nrange: 8\nstart_angle: {-math.pi}\nfield_of_view: {2 * math.pi}"
    sensor = sim.load_sensor(f"{lidar}\nresolution: {BEAMS}\nerror_std_dev: 0.2")
    wheels = core.kinematics.TwoWheelsDifferentialDriveKinematics(wheel_axis=0.2, max_speed=1.0)
    agent = sim.Agent(radius=0.16, kinematics=wheels)
    agent.pose = core.Pose2(_START[:2], _START[2])
    world.add_agent(agent)
    sensor.prepare_state(state)
    command = core.Twist2((_CIRCLE[0], 0.0), _CIRCLE[1], frame=core.Frame.relative)

    def step() -> None:
        agent.actuate(command, 0.1)
        sensor.update(agent, world, state)
        sensor.read_ranges(state)

    return Job(step)


def localize_steps(mode: str, size: int = 64) -> Job:
    """Return the job of lost robots, 1,000 particles each, in an env of Gymnasium's ``mode``."""
    few = {"name": "mcl", "particles": 1000}
    envs = gym.make_vec("deqmcl_gym/Localize-v0", size, mode, scan="table", localizer=few)
    envs.reset(seed=0)
    actions = np.tile(np.array([0.1, 0.1, 0.0], np.float32), (size, 1))
    return Job(lambda: envs.step(actions), size)


def _ratios() -> Iterator[Ratio]:
    ours = partial(rays, lambda room, poses: room.ranges(poses, BEARINGS))
    yield beside("rays_vs_numpy", "rays/s", ours, partial(rays, numpy_ranges))
    deq, other = (partial(filter_steps, name, N_10K) for name in ("deq-mcl", "mcl-map"))
    yield beside("deq_vs_map_step", "µs/step", partial(deq, lag=20), other)
    yield beside("deq_lag80_vs_lag10", "µs/step", partial(deq, lag=80), partial(deq, lag=10))
    for size, n in (("1k", 1_000), ("10k", N_10K)):
        plan, hedged, other = (
            partial(filter_steps, method, particles, "guided")
            for method, particles in (("mcl-plan", n), ("mcl-plan-hedged", 2 * n), ("mcl-map", n))
        )
        yield beside(f"plan_vs_map_step{size}", "µs/step", plan, other)
        yield beside(f"hedged_vs_map_step{size}", "µs/step", hedged, other)
    for method in ("mcl", "mcl-map", "deq-mcl"):
        yield trial_beside(f"trial_over_localizer_{method.replace('-', '_')}", method)
    yield trial_beside("trial_over_localizer_amcl", "amcl", "lost", lag=0)
    yield beside("room_vs_ir_sim", "steps/s", env_steps, ir_sim_steps, "irsim ir-sim")
    yield beside("room_vs_navground", "steps/s", env_steps, navground_steps, "navground navground")
    ours, other = (partial(vector_parts, whole=whole) for whole in (False, True))
    yield beside("vector64_not_rays_or_driving", "µs/step", ours, other)
    ours, other = (partial(localize_steps, mode) for mode in ("vector_entry_point", "sync"))
    yield beside("localize64", "steps/s", ours, other)


RATIOS = tuple(_ratios())
FULL, QUICK = Effort(15, seconds=0.2, worlds=200), Effort(11, seconds=0.06)


def measure(words: Sequence[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.studies.speed")
    parser.add_argument("--quick", action="store_true", help="less exact, in a few minutes")
    parser.add_argument(
        "--only", default="", metavar="WORD", help="figures with WORD in their names"
    )
    parser.add_argument("--out", type=Path, default=Path("results/speed"), metavar="DIR")
    options = parser.parse_args(words)
    rows = []
    asked = [ratio for ratio in RATIOS if options.only in ratio.name]
    for ratio in tqdm(asked, disable=None, leave=False):
        module, _, name = ratio.package.partition(" ")
        if module and find_spec(module) is None:
            print(f"{ratio.name} is left out: it needs {name}, so run pip install {name}.")
            continue
        ours, other = ratio.sides(QUICK if options.quick else FULL)
        rows.append([ratio.name, *(f"{n:.6g}" for n in (ours, other, ours / other)), ratio.unit])
    table = pd.DataFrame(rows, columns=["figure", "ours", "other", "ratio", "unit"])
    options.out.mkdir(parents=True, exist_ok=True)
    table.drop(columns="unit").to_csv(options.out / "speed.csv", index=False, lineterminator="\n")
    print(table.to_string(index=False))
    print(f"Written to {options.out}: speed.csv.")


if __name__ == "__main__":
    measure()
