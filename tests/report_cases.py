"""Made-up results with all that a report shows, and its files."""

import copy
import csv
import io

import numpy as np
import pytest
from msgspec.structs import replace as changed

from benchmarks.report import films
from benchmarks.report.page import write_report
from benchmarks.setup.overrides import Overrides
from benchmarks.setup.scenario import Thresholds
from benchmarks.sweeps.results import Failure, Results
from benchmarks.tables.comparison import FURTHER
from benchmarks.tables.frames import INNER, csv_of, trials_frame
from benchmarks.trials import Trial
from benchmarks.trials.scoring import SCORE_NAMES, ErrorCurve, Finished, WholeRun

STEPS = 60


def trial_of(localizer, number, *, params=None, world=None, assumed=None, disturbance=(), **given):
    base = {"scenario": "paper", "lag": 20, "seed": 0} | given
    return Trial(
        localizer=localizer,
        trial=number,
        params=Overrides(params or {}),
        world=Overrides(world or {}),
        assumed=Overrides(assumed or {}),
        disturbance=tuple(map(Overrides, disturbance)),
        **base,
    )


def finished(localizer, number, error, *, offsets=(0,), scores=None, quality=None, **setting):
    """A finished trial whose error is the same at every state; by offset, or at all ``offsets``."""
    errors = error if isinstance(error, dict) else dict.fromkeys(offsets, error)
    values = dict.fromkeys(SCORE_NAMES, 0.5) | {"lost": 0.0} | (scores or {})
    return Finished(
        trial=trial_of(localizer, number, **setting),
        scores=[values | {"offset": k, "error": e} for k, e in errors.items()],
        curves={k: ErrorCurve(max(k, 0), [e] * (STEPS + 1 - abs(k))) for k, e in errors.items()},
        profile={k: errors[0] for k in range(min(errors), max(errors) + 1, 5) if 0 in errors},
        quality=quality and [quality] * STEPS,
        steps_done=STEPS,
        scans_used=STEPS,
        events={},
        key=f"{localizer}-{number}-{setting.get('filter_seed', 0)}",
        seconds=0.06 * len(localizer),
        thresholds=Thresholds(),
        unit="px",
    )


def whole(record, scores, way):
    """The same trial with these scores of the whole run, and a way driven of so many metres."""
    curves = {"way": [0.0, way], "distance": [3.0, 0.0], "angle": [0.0, 0.0]}
    return changed(record, journey=WholeRun(scores=scores, curves=curves))


def trials(localizer, errors, **how):
    return [finished(localizer, world, error, **how) for world, error in enumerate(errors)]


def results(records, *, failures=(), missing=0, title="A sweep", baseline="mcl"):
    return Results(
        title=title,
        records=list(records),
        failures=[Failure(trial=trial, reason=reason) for trial, reason in failures],
        missing=missing,
        planned=len(records) + len(failures) + missing,
        command=["deqmcl", "sweep", "a b.toml", "--out", "there"],
        baseline=baseline,
        environment={"deqmcl-gym": "0.1.0", "code": "f00d"},
    )


def table_of(records, **how):
    table = results(records, **how).table
    return table.set_index(["method", "offset"], drop=False)


def results_csv(records, **how):
    return csv_of(results(records, **how).table, FURTHER)


def trials_csv(records):
    return csv_of(trials_frame(records), INNER)


def panels_of(records, **how):
    return results(records, **how).panels


def panel_of(records, **how):
    (panel,) = panels_of(list(records), **how)
    return panel


def lines_of(table):
    return table.frame.astype(str).to_numpy().tolist()


def written(out, given, laps=()):
    """Write the report of results, with these animations (whose pictures they have)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(films, "films_of", lambda panel: [*laps])
        patch.setattr(films, "filmed", copy.copy)  # they have their pictures
        return write_report(out, given)


def parsed(text):
    return list(csv.DictReader(io.StringIO(text)))


def paired(methods, worlds=12, **setting):
    """Trials of methods by name: (mean error, offsets), world by world with the same luck."""
    luck = np.random.default_rng(0).normal(0, 1, worlds)
    own = np.random.default_rng(1).normal(0, 0.1, (len(methods), worlds))
    return [
        finished(name, i, float(error + luck[i] + own[m, i]), offsets=offsets, **setting)
        for m, (name, (error, offsets)) in enumerate(methods.items())
        for i in range(worlds)
    ]


THREE = {"mcl": (20.0, (0,)), "deq-mcl": (16.0, (0, -20, 20))}
THREE["./my file.py:<b>&Mine$x$"] = (24.0, (0,))
TURNER = """
import numpy as np

class Turner:
    def __init__(self, robot, *, by=0.1):
        self.robot, self.by = robot, by
    def plan_at_reset(self, info):
        return None
    def act(self, belief, info):
        return np.array([0.0, self.by], np.float32), None
"""
