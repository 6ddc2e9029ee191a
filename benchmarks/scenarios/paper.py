"""The paper's setting, as far as its Table 1 tells."""

from benchmarks.setup.scenario import Scenario

SCENARIO = Scenario(
    words="one weak beam; the filters assume ten times the true motion noise or more",
    env={"preset": "paper"},
)
