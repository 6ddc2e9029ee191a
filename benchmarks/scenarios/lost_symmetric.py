"""Two wings alike: nearly all scans fit both, but the route leads from one to the other."""

from dataclasses import replace

from benchmarks.scenarios import lost

SCENARIO = replace(
    lost.SCENARIO,
    words="as lost, but both wings are alike and beams short; only one fits the route",
    env={
        **lost.SCENARIO.env,
        "floor_plan": {"office": {"wings": 2, "corridors": 1, "repeated": True}},
        "lidar": {**lost.SCENARIO.env["lidar"], "max_range": 5.0},
        # longer than any way within a wing of at most 24 m by 16 m: so it leaves through the middle
        "route": {"min_length": 36.0, "max_length": 60.0},
    },
)
