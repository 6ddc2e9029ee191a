"""The whole of a recorded log: each world is a run of the localizers on it."""

from dataclasses import fields

from benchmarks.scenarios.log import SCENARIO as LOG
from benchmarks.setup.logs import ReplayScenario

_SAME = {own.name: getattr(LOG, own.name) for own in fields(LOG)} | {
    "words": "the whole of a recorded log, as deqmcl replay runs it: each world is another run",
    "env": {name: value for name, value in LOG.env.items() if name != "segment"},
}
SCENARIO = ReplayScenario(**_SAME)
