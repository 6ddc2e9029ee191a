"""The named experiments, as data. A TOML file says the same: see ``sweepfile``."""

from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType

from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.suites.authors import AUTHOR_SUITES
from benchmarks.sweeps.suites.lost import LOST_SUITES
from benchmarks.sweeps.suites.paper import PAPER_METHODS, PAPER_SUITES, paper_suite, paper_sweep
from benchmarks.sweeps.suites.parts import methods
from benchmarks.sweeps.suites.study import STUDY_SUITES
from localizers import absolute_name

__all__ = [
    "FAMILIES",
    "PAPER_METHODS",
    "SUITES",
    "paper_suite",
    "paper_sweep",
    "with_localizers",
]

SUITES = MappingProxyType({**PAPER_SUITES, **AUTHOR_SUITES, **LOST_SUITES, **STUDY_SUITES})

# suites that are run one after the other under one name
FAMILIES = MappingProxyType({"study": tuple(STUDY_SUITES)})


def with_localizers(sweep: Sweep, names: Sequence[str]) -> Sweep:
    """Return a sweep with further localizers; one that it has already is not added."""
    known = {absolute_name(method.name) for method in sweep.localizers}
    added = [name for name in dict.fromkeys(names) if absolute_name(name) not in known]
    return replace(sweep, localizers=(*sweep.localizers, *methods(*added)))
