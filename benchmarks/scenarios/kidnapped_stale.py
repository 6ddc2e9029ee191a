"""Carried elsewhere in mid-route; the dispatcher does not see it."""

from dataclasses import replace

from benchmarks.scenarios import kidnapped

SCENARIO = replace(
    kidnapped.SCENARIO,
    words="as kidnapped, but the dispatcher does not see it: the old plan is shown and driven",
    disturbance=((("kind", "kidnap"), ("step", 75), ("noticed", False)),),
)
