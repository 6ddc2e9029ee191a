"""The world of ``guided``, its plan made before the start."""

from dataclasses import replace

from benchmarks.scenarios import guided

SCENARIO = replace(
    guided.SCENARIO,
    words="one weak beam and large noise; a lap planned before the start is driven as it is",
    env={"preset": "guided", "driver": "none"},
)
