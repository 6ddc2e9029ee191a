"""Looking ahead without degenerating: every method, on each scenario, against its limit."""

from types import MappingProxyType

from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.suites.limits import limits_of
from benchmarks.sweeps.suites.paper import CLASSICAL
from benchmarks.sweeps.suites.parts import axis, method, methods

_FILTERS = (
    *methods("mcl", "mcl-smoother", "mcl-map", "mcl-map-smoother", "deq-mcl"),
    *methods("deq-mcl-rejuvenated", "mcl-h", "mcl-pilots", "mcl-plan", "dead-reckoning"),
)
# Not in guided: there a table of h is made at every step, and a second form would take as long.
_TWISTED = method("mcl-h", form="twisted")
_CLASSICAL = methods(*CLASSICAL)
# AMCL's default, a likelihood field, says nothing at σ = 100 px in a room of this size.
_BEAM_AMCL = method("amcl", laser_model_type="robot")
_PARTICLES = (300, 1000)

LOOKAHEAD_SUITES = MappingProxyType(
    {
        "lookahead": Sweep(
            title="Looking ahead without degenerating: scenario paper, 200 worlds, 3 runs each",
            localizers=(*_FILTERS, _TWISTED),
            trials=200,
            filter_seeds=3,
            vary=(axis(params__particles=_PARTICLES),),
            limits=limits_of(_FILTERS),
        ),
        "guided": Sweep(
            title="Every method where localization is needed: scenario guided, 200 worlds",
            scenario="guided",
            localizers=(*_FILTERS, *_CLASSICAL, _BEAM_AMCL),
            trials=200,
            vary=(axis(params__particles=_PARTICLES),),
            limits=limits_of((*_FILTERS, *_CLASSICAL)),
        ),
        "matched": Sweep(
            title="Every method where all its assumptions are right: scenario matched, 200 worlds",
            scenario="matched",
            localizers=(*_FILTERS, _TWISTED, *_CLASSICAL),
            trials=200,
            vary=(axis(params__particles=_PARTICLES),),
        ),
        "sharp": Sweep(
            title="Looking ahead with a sharp sensor: scenario sharp, 200 worlds",
            scenario="sharp",
            localizers=(*_FILTERS, _TWISTED),
            trials=200,
            vary=(axis(params__particles=_PARTICLES),),
        ),
    }
)
