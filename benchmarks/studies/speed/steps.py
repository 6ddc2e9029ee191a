"""A localizer's step through its public ``update`` on a recorded lap, and its parts."""

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.studies.speed import numpy_baseline, peers
from benchmarks.studies.speed.figure import Figure, Job, Published, Side
from benchmarks.studies.speed.numpy_baseline import CasterMaker, segments, slabs
from benchmarks.studies.speed.work import BEAMS, fan, free_poses, recorded_lap, replanned_lap
from deqmcl_gym.world.config import PAPER_ROOM
from localizers import CensoredGaussianUniform, make
from localizers.models.scan import LidarScan, Scan

FEW, MANY = 1_000, 10_000


def our_job(name: str, *, beams: int = BEAMS, **params: int) -> Job:
    """Return the job of one of our localizers, its queue full."""
    lap = recorded_lap(beams)
    localizer = make(name, lap.robot, **params)
    localizer.reset(lap.prior, lap.first, np.random.default_rng(1))
    job = lap.following(localizer.update)
    for _ in range(params.get("lag", 0)):
        job.call()
    return job


def numpy_job(particles: int, caster: CasterMaker = segments) -> Job:
    """Return the job of MCL in NumPy."""
    lap, rng = recorded_lap(), np.random.default_rng(1)
    return lap.following(numpy_baseline.mcl(lap.robot, particles, lap.prior, rng, caster))


def peer_job(made: Callable[..., peers.Update]) -> Job:
    """Return the job of MCL as a peer's user would write it, given the NumPy models."""
    lap, rng = recorded_lap(), np.random.default_rng(1)
    return lap.following(made(lap.robot, FEW, lap.prior, rng))


def replanned_job(name: str, particles: int) -> Job:
    """Return the job of following a lap whose plan changes, over and over from its start.

    A queue has to redraw its future there, and a table of h is made anew; on a plan that is kept,
    both are spared.
    """
    lap = replanned_lap()
    localizer = make(name, lap.robot, particles=particles)

    def restart() -> None:
        localizer.reset(lap.prior, lap.first, np.random.default_rng(1))

    return lap.following(localizer.update, restart)


def scan_job(*, clipped: bool) -> Job:
    """Return the job of weighing a scan by a censored beam model, its beams clipped or not."""
    lap, lidar = recorded_lap(), fan(BEAMS)
    scan = LidarScan(floor_plan=PAPER_ROOM, lidar=lidar, beam=CensoredGaussianUniform())
    states = np.ascontiguousarray(free_poses(PAPER_ROOM, FEW).T)
    inside = lap.steps[0][0].astype(np.float64)
    ranges = np.full(BEAMS, lidar.max_range) if clipped else inside
    seen = Scan.of(ranges, lidar.max_range)
    return Job(lambda: scan.log_likelihood(states, seen))


def _versus(name: str, particles: int, other: Side, target: float | None = None) -> Figure:
    what = f"MCL step, N = {particles:,}, B = {BEAMS}"
    ours = Side("mcl", partial(our_job, "mcl", particles=particles))
    return Figure(name, what, "steps/s", ours, other, target)


def _peer(made: Callable[..., peers.Update], who: str) -> Figure:
    side = Side(f"{who}, given the NumPy models", partial(peer_job, made))
    return _versus(f"step1k_vs_{made.__name__}", FEW, side, 10)


def _deq(lag: int) -> Side:
    return Side(f"deq-mcl, L = {lag}", partial(our_job, "deq-mcl", particles=MANY, lag=lag))


def _replanned(figure: str, name: str, particles: int, target: float | None = None) -> Figure:
    what = f"step in scenario guided, a new plan at every step, N = {particles:,}, B = 1"
    ours = Side(f"{name}, L = 20", partial(replanned_job, name, particles))
    other = Side("mcl-map", partial(replanned_job, "mcl-map", particles))
    named = f"{figure}_vs_map_step{particles // 1000}k"
    return Figure(named, what, "µs/step", ours, other, target)


_STEP, _FEW = f"step, N = {MANY:,}, B = {BEAMS}", f"N = {FEW:,}, B = {BEAMS}"
_MAP = Side("mcl-map", partial(our_job, "mcl-map", particles=MANY))
_SAME = {"min_particles": FEW, "max_particles": FEW, "update_min_d": 0, "update_min_a": 0}

FIGURES = (
    *(
        _versus(f"{name}_vs_numpy{suffix}", n, Side(who, partial(numpy_job, n, caster)), target)
        for name, n, least in (("step1k", FEW, 10), ("step10k", MANY, 5))
        for suffix, who, caster, target in (
            ("", "NumPy, all walls", segments, least),
            ("_slabs", "NumPy, slab method", slabs, None),
        )
    ),
    Figure("deq_vs_map_step", _STEP, "µs/step", _deq(20), _MAP, 1.5),
    Figure("deq_lag80_vs_lag10", _STEP, "µs/step", _deq(80), _deq(10), 1.3),
    Figure(
        "amcl_step",
        f"step with a likelihood field and KLD-sampling, {_FEW}",
        "µs/step",
        Side("amcl", partial(our_job, "amcl", **_SAME)),
        Published("beluga, on another machine", 383),
    ),
    Figure(
        "censored_vs_inside",
        f"CensoredGaussianUniform by LidarScan, {_FEW}",
        "µs/scan",
        Side("all beams clipped", partial(scan_job, clipped=True)),
        Side("no beam clipped", partial(scan_job, clipped=False)),
    ),
    *(
        _replanned(figure, name, particles, target)
        for particles in (FEW, MANY)
        for figure, name, target in (
            ("plan", "mcl-plan", 5.0),
            ("replanned_deq", "deq-mcl", None),
            ("replanned_pilots", "mcl-pilots", None),
            ("replanned_h", "mcl-h", None),
        )
    ),
)
PEERS = (
    _peer(peers.particles, "particles"),
    _peer(peers.pfilter, "pfilter"),
    _peer(peers.stonesoup, "Stone Soup"),
)
