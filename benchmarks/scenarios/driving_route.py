"""The world of ``driving``, on the route of a dispatcher."""

from dataclasses import replace

from benchmarks.scenarios import driving

SCENARIO = replace(
    driving.SCENARIO,
    words="as driving, on the route of a dispatcher who knew the start",
    agent="on-route",
)
