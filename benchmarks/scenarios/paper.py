"""The paper's setting, as far as its Table 1 tells."""

from benchmarks.setup.scenario import Scenario

SCENARIO = Scenario(
    words="one weak beam; the filters assume ten times the motion noise there is, and more",
    env={"preset": "paper"},
)
