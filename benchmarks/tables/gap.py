"""How far every method is from the limit of its target, over the worlds that both have run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.setup.changes import Changes
from benchmarks.tables.pairing import Runs, by_world, runs_of
from benchmarks.tables.stats import Estimate, estimate
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Method, Setting


@dataclass(frozen=True)
class LimitRuns:
    """A limit as far as it has run.

    Attributes:
        of: localizers that are held against it; (): all that no other limit names.
        records: its finished trials, on all settings.
    """

    of: tuple[str, ...]
    records: list[Finished]


@dataclass(frozen=True, kw_only=True)
class Gap:
    """One method of a panel at one offset, against its limit at that offset; NaN: not known.

    Attributes:
        method, offset: of what.
        limit: what it is held against.
        worlds: that both have run; all means are over these.
        error: mean of e.
        seed_sd: SD of e between runs of the method on the same world.
        gap: mean of error - the limit's, 95 % bootstrap over worlds.
    """

    method: Method
    offset: int
    limit: Method
    worlds: int
    error: float
    seed_sd: float
    gap: Estimate


def gaps(
    setting: Setting,
    swept: Changes,
    methods: Mapping[Method, list[Finished]],
    limits: Sequence[LimitRuns],
) -> list[Gap]:
    """Hold the methods of a panel against their limits; each limit comes before its methods."""
    named = {name for limit in limits for name in limit.of}
    rows = []
    for limit in limits:
        # several methods, where the limit differs between values of what is swept
        theirs: dict[Method, list[Finished]] = {}
        for record in limit.records:
            if record.trial.setting == setting:
                theirs.setdefault(record.trial.method, []).append(record)
        own = {
            method: records
            for method, records in methods.items()
            if (method.name in limit.of if limit.of else method.name not in named)
        }
        held = {method: limit_of(swept, method, list(theirs)) for method in own}
        first = {one: theirs[one] for one in held.values() if one is not None}
        for method, records in ({**first, **own} | first).items():
            against = method if method in first else held[method]
            if against is not None:
                rows += _gaps(method, records, against, theirs[against])
    return rows


def limit_of(swept: Changes, method: Method, limits: Sequence[Method]) -> Method | None:
    """Return the limit with the panel's and the method's value of all in which limits differ."""
    limits = [limit for limit in limits if limit.agent == method.agent]
    told = [limit.params for limit in limits]
    names = {name for params in told for name in params}
    differing = {name for name in names if len({params.get(name) for params in told}) > 1}
    own = swept | method.params
    for limit, params in zip(limits, told, strict=True):
        if all(own[name] == params.get(name) for name in differing & own.keys()):
            return limit
    return None


def _gaps(
    method: Method, records: Sequence[Finished], limit: Method, reference: Sequence[Finished]
) -> list[Gap]:
    """Rows of a method at every offset; runs differ in number, so each world's are averaged."""
    rows = []
    for offset in dict.fromkeys(k for record in records for k in record.offsets):
        errors = runs_of(records, "error", offset)
        ours, theirs = by_world(errors), by_world(runs_of(reference, "error", offset))
        shared = [world for world in ours if world in theirs]
        if not shared:
            continue
        rows.append(
            Gap(
                method=method,
                offset=offset,
                limit=limit,
                worlds=len(shared),
                error=sum(ours[world] for world in shared) / len(shared),
                seed_sd=_seed_sd({run: e for run, e in errors.items() if run[0] in shared}),
                gap=estimate(np.array([ours[world] - theirs[world] for world in shared])),
            )
        )
    return rows


def _seed_sd(errors: Runs) -> float:
    """Root of the mean over worlds of the variance between runs (ddof 1)."""
    worlds: dict[int, list[float]] = {}
    for (world, _), error in errors.items():
        worlds.setdefault(world, []).extend([] if math.isnan(error) else [error])
    variances = [float(np.var(runs, ddof=1)) for runs in worlds.values() if len(runs) > 1]
    return math.sqrt(sum(variances) / len(variances)) if variances else math.nan
