"""A localizer's step through its public ``update``, on a recorded lap."""

from collections.abc import Callable
from functools import partial

from benchmarks.speed.figure import MICROSECONDS, Figure, Sides, require
from benchmarks.speed.lap import BEAMS, recorded_lap
from benchmarks.speed.numpy_baseline import Caster, NumpyMCL, segments, slabs
from benchmarks.speed.timing import Job
from deqmcl_gym.maps import PolygonMap
from localizers import Localizer, RobotModel, make

FEW, MANY = 1_000, 10_000


def our_job(name: str, particles: int, *, beams: int = BEAMS, **params: int) -> Job:
    """Return the job of one of our localizers, its queue full."""
    lap = recorded_lap(beams)
    localizer = make(name, lap.robot, particles=particles, **params)
    return lap.following(localizer, warm_up=params.get("lag", 0))


def numpy_sides(particles: int, caster: Callable[[PolygonMap], Caster]) -> Sides:
    """Return our MCL and the same in NumPy."""
    lap = recorded_lap()
    baseline = NumpyMCL(lap.robot, particles=particles, caster=caster)
    return our_job("mcl", particles), lap.following(baseline)


def peer_mcl(name: str, robot: RobotModel, particles: int) -> Localizer:
    """Return MCL as a peer's user would write it, given the NumPy models.

    Raises:
        UnavailableError: the peer is not installed.
    """
    require(name)
    if name == "particles":
        from benchmarks.speed.peers.particles import ParticlesMCL

        return ParticlesMCL(robot, particles=particles)
    if name == "pfilter":
        from benchmarks.speed.peers.pfilter import PfilterMCL

        return PfilterMCL(robot, particles=particles)
    from benchmarks.speed.peers.stonesoup import StoneSoupMCL

    return StoneSoupMCL(robot, particles=particles)


def peer_sides(name: str) -> Sides:
    """Return our MCL and a peer's."""
    lap = recorded_lap()
    peer = peer_mcl(name, lap.robot, FEW)
    return our_job("mcl", FEW), lap.following(peer)


def _mcl(particles: int) -> str:
    return f"MCL step, N = {particles:,}, B = {BEAMS}"


FIGURES = (
    *(
        Figure(
            name=f"{name}_vs_numpy{suffix}",
            task=_mcl(particles),
            ours="mcl",
            other=f"NumPy, {method}, float32 in blocks",
            unit="steps/s",
            target=None if suffix else target,
            sides=partial(numpy_sides, particles, caster),
        )
        for name, particles, target in (("step1k", FEW, 10), ("step10k", MANY, 5))
        for suffix, method, caster in (("", "all walls", segments), ("_slabs", "slabs", slabs))
    ),
    *(
        Figure(
            name=f"step1k_vs_{name}",
            task=_mcl(FEW),
            ours="mcl",
            other=f"{title}, given the NumPy models",
            unit="steps/s",
            target=10,
            sides=partial(peer_sides, name),
            peer=name,
        )
        for name, title in (
            ("particles", "particles"),
            ("pfilter", "pfilter"),
            ("stonesoup", "Stone Soup"),
        )
    ),
    Figure(
        name="deq_vs_map_step",
        task=f"step, N = {MANY:,}, B = {BEAMS}",
        ours="deq-mcl, L = 20",
        other="mcl-map",
        unit=MICROSECONDS,
        target=1.5,
        sides=lambda: (our_job("deq-mcl", MANY, lag=20), our_job("mcl-map", MANY)),
    ),
    Figure(
        name="deq_lag80_vs_lag10",
        task=f"step, N = {MANY:,}, B = {BEAMS}",
        ours="deq-mcl, L = 80",
        other="deq-mcl, L = 10",
        unit=MICROSECONDS,
        target=1.3,
        sides=lambda: (our_job("deq-mcl", MANY, lag=80), our_job("deq-mcl", MANY, lag=10)),
    ),
)
