"""Rates by a clock that the jobs themselves turn on: no test here depends on real time."""

import pytest

from benchmarks.speed.timing import Effort, Job, rates


class Clock:
    """CPU time that passes only as jobs say."""

    def __init__(self):
        self.now, self.log = 0.0, []

    def __call__(self):
        return self.now

    def job(self, name, seconds, amount=1.0):
        def call():
            self.log.append(name)
            self.now += seconds(len(self.log)) if callable(seconds) else seconds

        return Job(call=call, amount=amount)


def test_a_rate_is_the_units_done_per_second_of_the_clock():
    clock = Clock()
    jobs = [clock.job("a", 0.01, amount=50), clock.job("b", 0.25)]
    assert rates(jobs, Effort(repeats=3, seconds=0.1), clock) == pytest.approx([5000, 4])


def test_jobs_take_turns_that_are_at_least_as_long_as_asked_for():
    clock = Clock()
    jobs = [clock.job("a", 0.01), clock.job("b", 0.05), clock.job("c", 1.0)]
    rates(jobs, Effort(repeats=2, seconds=0.1), clock)
    turns = "".join(clock.log)[-2 * (10 + 2 + 1) :]
    assert turns == 2 * (10 * "a" + 2 * "b" + "c")


def test_a_slow_turn_among_five_changes_nothing():
    clock = Clock()
    slow_once = clock.job("a", lambda call: 100.0 if call == 5 else 0.01)
    assert rates([slow_once], Effort(repeats=5, seconds=0.01), clock) == pytest.approx([100])


def test_the_first_call_which_may_compile_is_not_measured():
    clock = Clock()
    compiling = clock.job("a", lambda call: 60.0 if call == 1 else 0.01)
    assert rates([compiling], Effort(repeats=1, seconds=0), clock) == pytest.approx([100])


def test_a_job_too_short_for_the_clock_has_a_finite_rate():
    clock = Clock()
    (rate,) = rates([clock.job("a", 0.0)], Effort(repeats=1, seconds=0), clock)
    assert 0 < rate < float("inf")
