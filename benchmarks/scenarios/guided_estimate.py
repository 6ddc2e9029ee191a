"""The world of ``guided``, driven and planned from the localizer's estimate."""

from dataclasses import replace

from benchmarks.scenarios import guided

SCENARIO = replace(
    guided.SCENARIO,
    words="as guided, but driven and planned from the localizer's own estimate",
    agent="on-estimate",
)
