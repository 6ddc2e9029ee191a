"""A localizer on a log, without a sweep around it."""

from benchmarks.setup.names import make_agent
from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.collecting import TrackLog
from benchmarks.trials.episode import moments
from deqmcl_gym.envs.log import LogEnv


def played(env, localizer, prior, rng):
    """Yield the moments of a localizer on a whole log."""
    return moments(env, make_agent("open-loop", None), localizer, lambda: prior, rng, seed=0)


def tracked(log, floor_plan, localizer, prior, rng):
    """Play a log to a localizer; return what was collected."""
    kept = TrackLog(log, floor_plan, Thresholds(), 0)
    for moment in played(LogEnv(log=log), localizer, prior, rng):
        kept.see(moment)
    return kept
