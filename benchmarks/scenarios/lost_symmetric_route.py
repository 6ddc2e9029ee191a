"""A building with a half turn of symmetry: two starts fit all scans and the route."""

from dataclasses import replace

from benchmarks.scenarios import lost_symmetric

SCENARIO = replace(
    lost_symmetric.SCENARIO,
    words="as lost-symmetric, but a half turn gives the same building: both fit the route",
    env={
        **lost_symmetric.SCENARIO.env,
        "floor_plan": {"office": {"wings": 2, "corridors": 1, "symmetric": True}},
    },
)
