"""The names of suites, without the suites: a misspelt one is refused before anything is loaded."""

from types import MappingProxyType

SUITE_NAMES = (
    *("quick", "paper", "headline", "particles", "lag", "beta", "sensor", "noise", "disturbed"),
    *("plan-sensor", "matched-sharp", "equal-time", "plan-validity", "authors"),
    *("lost", "lost-quick", "lost-hard", "lost-equal-time", "lost-regimes", "kidnapped", "driving"),
    *("study-sensor", "study-noise", "study-assumed", "study-particles", "study-lag"),
    *("study-beta", "study-plan", "study-pilots"),
)

# suites that are run one after the other under one name
FAMILIES = MappingProxyType(
    {"study": tuple(name for name in SUITE_NAMES if name.startswith("study-"))}
)
