"""The limit of each target: one of its filters with very many particles."""

from collections.abc import Sequence
from typing import Any

from benchmarks.sweeps.design import Limit, Method
from benchmarks.sweeps.suites.parts import method

PARTICLES = 100_000


def limits_of(localizers: Sequence[Method]) -> tuple[Limit, ...]:
    """Return the limits of the targets that these localizers have."""
    names = {localizer.name for localizer in localizers}
    return tuple(limit for limit in _LIMITS if names.intersection(limit.of))


def _limit(of: tuple[str, ...], name: str, **params: Any) -> Limit:
    return Limit(method=method(name, particles=PARTICLES, **params), of=of)


_LIMITS = (
    # the smoothers are the plain filters at x_t, and the limit of the past, too
    _limit(("mcl", "mcl-smoother", "grid", "ekf"), "mcl-smoother"),
    _limit(("mcl-map", "mcl-map-smoother"), "mcl-map-smoother"),
    # one pilot is enough: the estimate is unbiased at any number of them
    _limit(("deq-mcl", "deq-mcl-rejuvenated", "mcl-h", "mcl-pilots"), "mcl-pilots", pilots=1),
    _limit(("mcl-plan",), "mcl-plan", keep=0.0),
)
