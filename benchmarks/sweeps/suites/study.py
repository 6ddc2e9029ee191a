"""When does knowing the plan help? One factor at a time around two centres; see docs/study.md.

``matched`` executes a plan that is known and stays; in ``guided`` it is made from the true pose and
new at every step. Everything is compared with map-based MCL, which knows all but the plan.
"""

from dataclasses import replace
from types import MappingProxyType
from typing import Any

from benchmarks.setup.changes import Changes
from benchmarks.sweeps.design import Axis, Sweep
from benchmarks.sweeps.suites.parts import axis, home_again, methods, noises, wrapper

_CENTRES = axis(scenario=("matched", "guided"))
_CHANGED = wrapper("plan-change", step=100, actions=home_again())
_SIGMAS = (5.0, 25.0, 100.0)
_NOISES = (0.02, 0.05, 0.1, 0.2)
_ASSUMED = (0.02, 0.1, 0.2, 0.4)


def _study(title: str, *axes: Axis, **changes: Any) -> Sweep:
    base = Sweep(
        title=f"When does knowing the plan help? {title}",
        localizers=methods("mcl", "mcl-map", "deq-mcl", "mcl-pilots", "dead-reckoning"),
        baseline="mcl-map",
        trials=25,
        filter_seeds=2,
        params=Changes({"particles": 300}),
        vary=(_CENTRES, *axes),
    )
    return replace(base, **changes)


STUDY_SUITES = MappingProxyType(
    {
        "study-sensor": _study(
            "The sensor, which the filters know",
            axis(world__lidar__beams=(1, 9)),
            axis(world__lidar__sigma=_SIGMAS, assumed__scan__sigma=_SIGMAS),
        ),
        "study-noise": _study(
            "The noise of the motion, which the filters know",
            axis(**noises("world__noise", _NOISES, 10), **noises("assumed__motion", _NOISES, 10)),
        ),
        "study-assumed": _study(
            "The noise that the filters assume", axis(**noises("assumed__motion", _ASSUMED, 10))
        ),
        "study-particles": _study(
            "The number of particles", axis(params__particles=(100, 300, 1000))
        ),
        "study-lag": _study("The lag L: how far ahead a filter looks", axis(lag=(5, 20, 40))),
        "study-beta": _study(
            "β, the charge on a step that collides", axis(params__beta=(1.0, 3.0, 10.0))
        ),
        "study-plan": _study(
            "A plan that is kept, and one that changes halfway round",
            scenario="matched",
            vary=(axis(disturbance=((), (_CHANGED,))),),
        ),
        "study-pilots": _study(
            "Roll-outs per particle: M of the redraw in DEQ-MCL, K of pilots",
            localizers=methods("mcl-map", "deq-mcl", "mcl-pilots"),
            scenario="guided",
            vary=(axis(params__pilots=(4, 16, 64)),),
        ),
    }
)
