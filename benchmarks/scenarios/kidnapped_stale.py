"""Carried elsewhere in mid-route; whoever drives sees it, the dispatcher does not."""

from dataclasses import replace

from benchmarks.scenarios import kidnapped

SCENARIO = replace(
    kidnapped.SCENARIO,
    words="as kidnapped, driven alike; but the localizer is shown what is left of the old plan",
    agent="old-route",
)
