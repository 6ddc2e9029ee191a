"""gaps.csv: how far every method is from the limit, over the worlds that both have run."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np

from benchmarks.tables.pairing import (
    METHOD_COLUMNS,
    SETTING_COLUMNS,
    Method,
    Record,
    Setting,
    method_of,
    setting_of,
    world_scores,
)
from benchmarks.tables.stats import paired_bootstrap
from benchmarks.tables.text import csv_text

Cells = dict[tuple[Setting, Method], list[Record]]


@dataclass(frozen=True, kw_only=True)
class Gap:
    """One method of a setting at one offset, against the limit at that offset; NaN: not known.

    Attributes:
        setting, method, offset: of what.
        limit: what it is held against.
        worlds: that both have run; all means are over these.
        error: mean of e.
        seed_sd: SD of e between runs of the method on the same world.
        gap, gap_low, gap_high: mean of error - the limit's, 95 % bootstrap over worlds.
    """

    setting: Setting
    method: Method
    offset: int
    limit: Method
    worlds: int
    error: float
    seed_sd: float
    gap: float
    gap_low: float
    gap_high: float


def gaps(records: Sequence[Record], limits: Sequence[Record]) -> list[Gap]:
    """Hold every method against the limit of its setting; the limit itself comes first."""
    theirs, ours = _cells(limits), _cells(records)
    rows = []
    for (setting, method), own in ({**theirs, **ours} | theirs).items():
        limit = limit_of(method, [one for other, one in theirs if other == setting])
        if limit is None:
            continue
        reference = theirs[setting, limit]
        offsets = dict.fromkeys(score["offset"] for record in own for score in record["scores"])
        found = (_gap(setting, method, offset, own, limit, reference) for offset in offsets)
        rows += [row for row in found if row is not None]
    return rows


def limit_of(method: Method, limits: Sequence[Method]) -> Method | None:
    """Return the limit with the method's value of every parameter in which the limits differ."""
    told = [json.loads(limit.params) for limit in limits]
    names = {name for params in told for name in params}
    differing = {n for n in names if len({json.dumps(params.get(n)) for params in told}) > 1}
    own = json.loads(method.params)
    for limit, params in zip(limits, told, strict=True):
        if all(own[name] == params.get(name) for name in differing & own.keys()):
            return limit
    return None


def gaps_csv(rows: Iterable[Gap]) -> str:
    """Return gaps.csv: one line per setting, method and offset."""
    plain = [f.name for f in fields(Gap) if f.name not in ("setting", "method", "limit")]
    header = [*SETTING_COLUMNS, *METHOD_COLUMNS, "limit", "limit_params", *plain]
    lines = (
        [
            *(*astuple(row.setting), *astuple(row.method), *astuple(row.limit)),
            *(getattr(row, name) for name in plain),
        ]
        for row in rows
    )
    return csv_text(header, lines)


def apart(ours: Mapping[int, float], theirs: Mapping[int, float]) -> tuple[float, float, float]:
    """Mean of ours - theirs over the worlds in both, and its 95 % bootstrap interval."""
    differences = np.array([ours[world] - theirs[world] for world in ours if world in theirs])
    if not differences.size:
        return math.nan, math.nan, math.nan
    return (float(differences.mean()), *paired_bootstrap(differences))


def _gap(
    setting: Setting,
    method: Method,
    offset: int,
    own: Sequence[Record],
    limit: Method,
    reference: Sequence[Record],
) -> Gap | None:
    ours = world_scores(own, "error", offset)
    theirs = world_scores(reference, "error", offset)
    shared = [world for world in ours if world in theirs]
    if not shared:
        return None
    gap, low, high = apart(ours, theirs)
    return Gap(
        setting=setting,
        method=method,
        offset=offset,
        limit=limit,
        worlds=len(shared),
        error=sum(ours[world] for world in shared) / len(shared),
        seed_sd=_seed_sd([r for r in own if r["trial"]["trial"] in shared], offset),
        gap=gap,
        gap_low=low,
        gap_high=high,
    )


def _seed_sd(records: Sequence[Record], offset: int) -> float:
    """Root of the mean over worlds of the variance between runs (ddof 1)."""
    worlds: dict[int, list[float]] = {}
    for record in records:
        for score in record["scores"]:
            if score["offset"] == offset and score["error"] is not None:
                worlds.setdefault(record["trial"]["trial"], []).append(score["error"])
    variances = [float(np.var(runs, ddof=1)) for runs in worlds.values() if len(runs) > 1]
    return math.sqrt(sum(variances) / len(variances)) if variances else math.nan


def _cells(records: Sequence[Record]) -> Cells:
    cells: Cells = {}
    for record in records:
        key = setting_of(record["trial"]), method_of(record["trial"])
        cells.setdefault(key, []).append(record)
    return cells
