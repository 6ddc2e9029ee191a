"""The world of ``guided``, the localizer shown the plan of another start."""

from dataclasses import replace

from benchmarks.scenarios import guided

SCENARIO = replace(
    guided.SCENARIO,
    words="as guided, but the localizer is shown the plan of another start",
    agent="stale",
)
