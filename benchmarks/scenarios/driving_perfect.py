"""The world of ``driving``, driven by one who sees the true pose: what is possible."""

from dataclasses import replace

from benchmarks.scenarios import driving

SCENARIO = replace(
    driving.SCENARIO,
    words="as driving, but driven from the true pose",
    agent="open-loop",
)
