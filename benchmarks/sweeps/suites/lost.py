"""Lost, kidnapped, driving: filters that see a route and filters that do not; see docs/lost.md.

``lag`` is 0 in all of them: what is believed of the past is not scored. Of ``mcl-plan`` it is how
many steps of the plan are evidence at every step, 0.2 m each.
"""

from dataclasses import replace
from types import MappingProxyType

from benchmarks.setup.changes import Changes
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.suites.parts import AMCL_ON_ROBOT, axis, method, methods

_AHEAD = 50  # steps of the plan: 10 m
_DRAWS = {"start_draws": 20, "start_jitter": 0.3}  # m; without it few poses are left
# as Nav2 recommends for robots that may be anywhere; every filter here that can has it
_RECOVERY = {"recovery_alpha_slow": 0.001, "recovery_alpha_fast": 0.1}

_BLIND = methods("mcl", "mcl-map")
_SENSOR = method("mcl-plan", lag=_AHEAD)
_START = method("mcl-map", **_DRAWS)
# Nav2's own assumptions, and those of all others
_AMCL = (
    method("amcl", max_particles=20_000),
    replace(AMCL_ON_ROBOT, params=AMCL_ON_ROBOT.params | {"max_particles": 20_000}),
)
_DRIVEN = (method("amcl"), AMCL_ON_ROBOT)
# a start informed by the plan costs about as long as the run: the rival has twice the particles
_ONCE = method("mcl-plan", lag=0, **_DRAWS, particles=5_000)
_RIVAL = method("mcl-map", particles=10_000)

LOST_SUITES = MappingProxyType(
    {
        "lost": Sweep(
            title="Lost in an office building, with a dispatcher's route: 100 worlds",
            scenario="lost",
            localizers=(*_BLIND, method("mcl-map", particles=50_000), *_AMCL, _SENSOR, _START),
            baseline="mcl-map",
            lag=0,
            trials=100,
            params=Changes(_RECOVERY),
            vary=(axis(params__particles=(2_000, 10_000)),),
        ),
        "lost-quick": Sweep(
            title="Lost in an office building: a quick look",
            scenario="lost",
            localizers=(*methods("mcl-map"), _SENSOR, _START),
            baseline="mcl-map",
            lag=0,
            trials=20,
            params=Changes({"particles": 5_000, **_RECOVERY}),
        ),
        "lost-hard": Sweep(
            title="Lost with one weak beam, and where two places fit the scans: 100 worlds",
            localizers=(*methods("mcl-map"), _SENSOR, _START),
            baseline="mcl-map",
            lag=0,
            trials=100,
            params=Changes({"particles": 10_000, **_RECOVERY}),
            vary=(axis(scenario=("lost-weak", "lost-symmetric", "lost-symmetric-route")),),
        ),
        "lost-equal-time": Sweep(
            title="A route at the start, or its time spent on particles: 100 worlds, 2 runs each",
            localizers=(_RIVAL, method("mcl", particles=10_000), _ONCE),
            baseline="mcl-map",
            lag=0,
            trials=100,
            filter_seeds=2,
            params=Changes(_RECOVERY),
            vary=(axis(scenario=("lost", "lost-weak", "lost-symmetric")),),
        ),
        "lost-regimes": Sweep(
            title="Where a route at the start pays: beams, width of corridors, length of the route",
            scenario="lost",
            localizers=(_RIVAL, _ONCE),
            baseline="mcl-map",
            lag=0,
            trials=20,
            params=Changes(_RECOVERY),
            vary=(
                axis(world__lidar__beams=(1, 4, 16)),
                axis(world__floor_plan__office__corridor=(1.2, 2.0, 3.2)),
                axis(
                    world__route__min_length=(8.0, 20.0, 40.0),
                    world__route__max_length=(12.0, 28.0, 60.0),
                ),
            ),
        ),
        "kidnapped": Sweep(
            title="Carried off in mid-route, with a new plan and with the old one: 100 worlds",
            localizers=(*methods("mcl-map"), *_AMCL, _SENSOR, _START),
            baseline="mcl-map",
            lag=0,
            trials=100,
            params=Changes(_RECOVERY),
            vary=(
                axis(scenario=("kidnapped", "kidnapped-stale")),
                axis(params__particles=(2_000, 10_000)),
            ),
        ),
        "amcl-lost": Sweep(
            title="Nav2's AMCL, lost or kidnapped, with its assumptions and others': 100 worlds",
            localizers=(*methods("mcl-map"), *_AMCL),
            baseline="mcl-map",
            lag=0,
            trials=100,
            params=Changes({"particles": 10_000, **_RECOVERY}),
            vary=(axis(scenario=("lost", "kidnapped")),),
        ),
        "amcl-driving": Sweep(
            title="Nav2's AMCL to a goal through doors: 100 worlds",
            localizers=(*methods("mcl-map"), *_DRIVEN),
            baseline="mcl-map",
            lag=0,
            trials=100,
            params=Changes({"particles": 2_000}),
            vary=(axis(scenario=("driving", "driving-route")),),
        ),
        "driving": Sweep(
            title="To a goal through doors, driven on the estimate: 100 worlds",
            localizers=(*_BLIND, *_DRIVEN, _SENSOR, *methods("dead-reckoning")),
            baseline="mcl-map",
            lag=0,
            trials=100,
            vary=(
                axis(scenario=("driving", "driving-route", "driving-blind", "driving-perfect")),
                axis(params__particles=(500, 2_000)),
            ),
        ),
    }
)
