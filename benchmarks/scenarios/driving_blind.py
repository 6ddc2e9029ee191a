"""The world of ``driving``, its plan carried out as it was before the start."""

from dataclasses import replace

from benchmarks.scenarios import driving

SCENARIO = replace(
    driving.SCENARIO,
    words="as driving, but the plan made before the start is driven as it is",
    env={**driving.SCENARIO.env, "driver": "none"},
    agent="open-loop",
)
