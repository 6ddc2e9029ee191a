"""Every method beside the plan as a sensor, each against its limit; and whose plan it is."""

from types import MappingProxyType

from benchmarks.setup.changes import Changes
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.suites.limits import limits_of
from benchmarks.sweeps.suites.paper import CLASSICAL
from benchmarks.sweeps.suites.parts import AMCL_ON_ROBOT, axis, method, methods, noises

_BEAMS, _SIGMAS = (1, 9, 9), (100.0, 50.0, 5.0)  # weak, middle, sharp
_NOISES = (0.02, 0.2)

_PARTICLES = axis(params__particles=(300, 1000))

_FILTERS = (
    *methods("mcl", "mcl-smoother", "mcl-map", "mcl-map-smoother", "mcl-plan", "mcl-pilots"),
    *methods("mcl-h", "deq-mcl", "deq-mcl-rejuvenated", "dead-reckoning"),
)
# Nav2's AMCL assumes a sensor of σ = 0.2 m, 10 px, whatever the robot's is.
_CLASSICAL = (*methods(*CLASSICAL), AMCL_ON_ROBOT)
_AMCL = (*methods("amcl"), AMCL_ON_ROBOT)
_EXACT, _ONCE = method("mcl-plan", keep=0.0), method("mcl-plan", charge="new")

AUTHOR_SUITES = MappingProxyType(
    {
        "plan-sensor": Sweep(
            title="Every method, where the plan is made from the true pose or not: 200 worlds",
            localizers=(*_FILTERS, *(_EXACT, _ONCE), *_CLASSICAL),
            baseline="mcl-map",
            trials=200,
            filter_seeds=3,
            vary=(axis(scenario=("guided", "paper")), _PARTICLES),
            limits=limits_of((*_FILTERS, *_CLASSICAL)),
        ),
        "amcl-rooms": Sweep(
            title="Nav2's AMCL, with its assumptions and those of all others: 200 worlds",
            localizers=(*methods("mcl-map"), *_AMCL),
            baseline="mcl-map",
            trials=200,
            filter_seeds=3,
            params=Changes({"particles": 300}),
            vary=(axis(scenario=("guided", "paper")),),
        ),
        "matched-sharp": Sweep(
            title="Every method, all assumptions right or a sharp sensor: 200 worlds",
            localizers=(*_FILTERS, *_CLASSICAL),
            baseline="mcl-map",
            trials=200,
            vary=(axis(scenario=("matched", "sharp")), _PARTICLES),
        ),
        "equal-time": Sweep(
            title="The plan as a sensor, or its time spent on particles: scenario guided",
            localizers=(
                method("mcl-plan", particles=1_000),
                # as many as take its time: 8,000 for 0.3 ms, by `deqmcl speed`
                *(method(name, particles=8_000) for name in ("mcl-map", "mcl")),
            ),
            scenario="guided",
            baseline="mcl-map",
            trials=200,
        ),
        "plan-validity": Sweep(
            title="A latent 'the plan is about this robot': does it notice a stale plan?",
            localizers=(
                *methods("mcl-map"),
                *(_EXACT, method("mcl-plan", keep=0.0, validity=0.01)),
            ),
            baseline="mcl-map",
            trials=40,
            params=Changes({"particles": 300}),
            vary=(
                axis(scenario=("guided", "guided-stale")),
                axis(
                    world__lidar__beams=_BEAMS[:2],
                    world__lidar__sigma=_SIGMAS[:2],
                    assumed__scan__sigma=_SIGMAS[:2],
                ),
            ),
        ),
        "authors": Sweep(
            title="Who plans? From the true pose, before the start, from the estimate, or stale",
            localizers=methods("mcl-map", "mcl-plan", "mcl-pilots", "dead-reckoning"),
            baseline="mcl-map",
            trials=40,
            params=Changes({"particles": 300}),
            vary=(
                axis(scenario=("guided", "guided-before", "guided-estimate", "guided-stale")),
                axis(
                    world__lidar__beams=_BEAMS,
                    world__lidar__sigma=_SIGMAS,
                    assumed__scan__sigma=_SIGMAS,
                ),
                axis(
                    **noises("world__noise", _NOISES, 10), **noises("assumed__motion", _NOISES, 10)
                ),
            ),
        ),
    }
)
