"""Rates by a clock that the jobs themselves turn on: no test here depends on real time."""

import pytest

from benchmarks.studies.speed.figure import Effort, Job, rates


class Clock:
    """Time that passes only as jobs say; notes who ran."""

    def __init__(self):
        self.now, self.log = 0.0, []

    def job(self, name, seconds, amount=1.0):
        def call():
            self.log.append(name)
            self.now += seconds(len(self.log)) if callable(seconds) else seconds

        return Job(call, amount, clock=lambda: self.now)


def test_jobs_take_turns_that_are_at_least_as_long_as_asked_for():
    clock = Clock()
    jobs = [clock.job("a", 0.01, amount=50), clock.job("b", 0.05), clock.job("c", 1.0)]
    assert rates(jobs, Effort(repeats=2, seconds=0.1)) == pytest.approx([5000, 20, 1])
    turns = "".join(clock.log)[-2 * (10 + 2 + 1) :]
    assert turns == 2 * (10 * "a" + 2 * "b" + "c")


@pytest.mark.parametrize(("slow_call", "repeats"), [(1, 1), (5, 5)])
def test_neither_a_first_call_that_compiles_nor_one_slow_turn_changes_a_rate(slow_call, repeats):
    job = Clock().job("a", lambda call: 60.0 if call == slow_call else 0.01)
    assert rates([job], Effort(repeats=repeats, seconds=0.01)) == pytest.approx([100])


def test_a_job_too_short_for_the_clock_has_a_finite_rate():
    (rate,) = rates([Clock().job("a", 0.0)], Effort(repeats=1, seconds=0))
    assert 0 < rate < float("inf")
