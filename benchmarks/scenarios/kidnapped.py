"""Carried elsewhere in mid-route; the dispatcher sees it and plans from there."""

from dataclasses import replace

from benchmarks.scenarios import lost

SCENARIO = replace(
    lost.SCENARIO,
    words="as lost, but carried elsewhere before step 75; the dispatcher plans from there",
    env={**lost.SCENARIO.env, "route": {"min_length": 30.0, "max_length": 60.0}},
    disturbance=((("kind", "kidnap"), ("step", 75)),),
)
