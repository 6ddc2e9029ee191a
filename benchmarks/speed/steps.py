"""A localizer's step through its public ``update`` on a recorded lap, and its parts."""

from functools import partial
from importlib import import_module

import numpy as np

from benchmarks.speed.figure import Figure, Published, Side
from benchmarks.speed.lap import BEAMS, PLANNED, fan, free_poses, recorded_lap
from benchmarks.speed.numpy_baseline import CasterMaker, mcl, segments, slabs
from benchmarks.speed.timing import Job
from deqmcl_gym.world.config import PAPER_ROOM
from localizers import CensoredGaussianUniform, make
from localizers.models.scan import LidarScan

FEW, MANY = 1_000, 10_000


def our_job(name: str, *, beams: int = BEAMS, **params: int) -> Job:
    """Return the job of one of our localizers, its queue full."""
    lap = recorded_lap(beams)
    localizer = make(name, lap.robot, **params)
    localizer.reset(lap.prior, lap.plan[:PLANNED], np.random.default_rng(1))
    return lap.following(localizer.update, warm_up=params.get("lag", 0))


def numpy_job(particles: int, caster: CasterMaker = segments) -> Job:
    """Return the job of MCL in NumPy."""
    lap, rng = recorded_lap(), np.random.default_rng(1)
    return lap.following(mcl(lap.robot, particles, lap.prior, rng, caster))


def peer_job(name: str) -> Job:
    """Return the job of MCL as a peer's user would write it, given the NumPy models."""
    lap, rng = recorded_lap(), np.random.default_rng(1)
    peer = import_module(f"benchmarks.speed.peers.{name}")
    return lap.following(peer.mcl(lap.robot, FEW, lap.prior, rng))


def scan_job(*, clipped: bool) -> Job:
    """Return the job of weighing a scan by a censored beam model, its beams clipped or not."""
    lap, lidar = recorded_lap(), fan(BEAMS)
    scan = LidarScan(floor_plan=PAPER_ROOM, lidar=lidar, beam=CensoredGaussianUniform())
    states = np.ascontiguousarray(free_poses(PAPER_ROOM, FEW).T)
    ranges = np.full(BEAMS, lidar.max_range) if clipped else lap.scans[0].astype(np.float64)
    return Job(lambda: scan.log_likelihood(states, ranges))


def _versus(name: str, particles: int, other: Side, target: float | None = None) -> Figure:
    return Figure(
        name=name,
        what=f"MCL step, N = {particles:,}, B = {BEAMS}",
        unit="steps/s",
        ours=Side("mcl", partial(our_job, "mcl", particles=particles)),
        other=other,
        target=target,
    )


def _peer(name: str, who: str) -> Figure:
    side = Side(f"{who}, given the NumPy models", partial(peer_job, name))
    return _versus(f"step1k_vs_{name}", FEW, side, 10)


def _queue(name: str, ours: Side, other: Side, target: float) -> Figure:
    what = f"step, N = {MANY:,}, B = {BEAMS}"
    return Figure(name=name, what=what, unit="µs/step", ours=ours, other=other, target=target)


def _deq(lag: int) -> Side:
    return Side(f"deq-mcl, L = {lag}", partial(our_job, "deq-mcl", particles=MANY, lag=lag))


_MAP = Side("mcl-map", partial(our_job, "mcl-map", particles=MANY))
_AMCL = Side(
    "amcl",
    partial(
        our_job,
        "amcl",
        min_particles=FEW,
        max_particles=FEW,
        update_min_d=0,
        update_min_a=0,
    ),
)

FIGURES = (
    *(
        _versus(f"{name}_vs_numpy{suffix}", n, Side(who, partial(numpy_job, n, caster)), target)
        for name, n, least in (("step1k", FEW, 10), ("step10k", MANY, 5))
        for suffix, who, caster, target in (
            ("", "NumPy, all walls", segments, least),
            ("_slabs", "NumPy, slab method", slabs, None),
        )
    ),
    _queue("deq_vs_map_step", _deq(20), _MAP, 1.5),
    _queue("deq_lag80_vs_lag10", _deq(80), _deq(10), 1.3),
    Figure(
        name="amcl_step",
        what=f"step with a likelihood field and KLD-sampling, N = {FEW:,}, B = {BEAMS}",
        unit="µs/step",
        ours=_AMCL,
        other=Published("beluga, on another machine", 383),
    ),
    Figure(
        name="censored_vs_inside",
        what=f"CensoredGaussianUniform by LidarScan, N = {FEW:,}, B = {BEAMS}",
        unit="µs/scan",
        ours=Side("all beams clipped", partial(scan_job, clipped=True)),
        other=Side("no beam clipped", partial(scan_job, clipped=False)),
    ),
)
PEERS = (
    _peer("particles", "particles"),
    _peer("pfilter", "pfilter"),
    _peer("stonesoup", "Stone Soup"),
)
