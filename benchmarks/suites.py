"""The named experiments, as data: lists of trials."""

from collections.abc import Sequence
from typing import Any

from benchmarks.spec import Trial
from localizers import parameters

PAPER_METHODS = (
    "mcl",
    "mcl-smoother",
    "mcl-map",
    "mcl-map-smoother",
    "deq-mcl",
    "dead-reckoning",
)


def paper_suite(
    *,
    preset: str,
    localizers: Sequence[str],
    trials: int,
    seed: int,
    lag: int,
    **params: Any,
) -> list[Trial]:
    """Return the paper's experiment: all methods on the same ``trials`` worlds.

    Args:
        preset: name of the world.
        localizers: names; each gets those of ``params`` (and ``lag``) that it has a use for.
        trials: number of worlds.
        seed: root of all randomness.
        lag: L.
        params: of the localizers.
    """
    return [
        Trial(
            preset=preset,
            localizer=name,
            params=_useful(name, params | {"lag": lag}),
            lag=lag,
            seed=seed,
            trial=number,
        )
        for name in localizers
        for number in range(trials)
    ]


def _useful(name: str, params: dict[str, Any]) -> tuple[tuple[str, Any], ...]:
    known = parameters(name)
    return tuple(sorted((k, v) for k, v in params.items() if known is None or k in known))
