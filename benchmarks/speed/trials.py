"""A whole trial of the paper's experiment, against the time that its localizer takes of it."""

import time
from functools import partial

from benchmarks.speed.figure import Figure, Side
from benchmarks.speed.timing import Job
from benchmarks.sweeps.suites import paper_suite
from benchmarks.trials.attempt import attempt
from benchmarks.trials.plugins import key_of

PARTICLES = 1_000
TARGET = 2.0


def trial_job(name: str, *, localizer_only: bool) -> Job:
    """Return the job of a trial, with the wall's clock or with what its localizer counts."""
    (trial,) = paper_suite(localizers=[name], trials=1, particles=PARTICLES)
    spent = 0.0

    def run() -> None:
        nonlocal spent
        outcome = attempt(trial, key_of(trial))
        assert outcome.reason is None, outcome.reason
        spent += outcome.seconds

    return Job(run, clock=(lambda: spent) if localizer_only else time.perf_counter)


FIGURES = tuple(
    Figure(
        name=f"trial_{name.replace('-', '_')}",
        what=f"trial of {name} in scenario paper, N = {PARTICLES:,}; wall time",
        unit="ms/trial",
        ours=Side("world, localizer and scores", partial(trial_job, name, localizer_only=False)),
        other=Side("its localizer's share", partial(trial_job, name, localizer_only=True)),
        target=TARGET,
    )
    for name in ("mcl", "deq-mcl")
)
