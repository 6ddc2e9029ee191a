"""Looking ahead without degenerating: every method, on each scenario, against the limit."""

from types import MappingProxyType

from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.factors import Limit
from benchmarks.sweeps.suites.paper import CLASSICAL
from benchmarks.sweeps.suites.parts import axis, method, methods

_FILTERS = (
    *methods("mcl", "mcl-smoother", "mcl-map", "mcl-map-smoother", "deq-mcl"),
    *methods("deq-mcl-rejuvenated", "mcl-h", "mcl-pilots", "dead-reckoning"),
)
# Not in guided: there a table of h is made at every step, and a second form would take as long.
_TWISTED = method("mcl-h", form="twisted")
_CLASSICAL = methods(*CLASSICAL)
_PARTICLES = (300, 1000)

# One pilot is enough: the estimate is unbiased at any number of them.
LIMIT = Limit(method=method("mcl-pilots", particles=100_000, pilots=1), trials=20, filter_seeds=2)

LOOKAHEAD_SUITES = MappingProxyType(
    {
        "lookahead": Sweep(
            title="Looking ahead without degenerating: scenario paper, 200 worlds, 3 runs each",
            localizers=(*_FILTERS, _TWISTED),
            trials=200,
            filter_seeds=3,
            vary=(axis(params__particles=_PARTICLES),),
            limit=LIMIT,
        ),
        "guided": Sweep(
            title="Every method where localization is needed: scenario guided, 200 worlds",
            scenario="guided",
            localizers=(*_FILTERS, *_CLASSICAL),
            trials=200,
            vary=(axis(params__particles=_PARTICLES),),
            limit=LIMIT,
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
