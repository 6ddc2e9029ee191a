"""Every method of a panel against the paper's methods, run by run."""

from benchmarks.tables.pairing import differences, runs_of
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import Estimate, estimate
from benchmarks.trials.spec import Method

_NOW = ("mcl", "mcl-map", "deq-mcl")
_PAST = ("mcl-smoother", "mcl-map-smoother", "deq-mcl")

Rivals = dict[Method, dict[Method, Estimate]]


def rivals(panel: Panel) -> dict[int, Rivals]:
    """Return differences of errors at x_t and x_{t-L}, by offset, method and rival.

    Each is the mean over worlds of error - the rival's at the same offset, with its interval.
    Offsets without a rival are left out.
    """
    offsets = {0: _NOW} | ({-panel.setting.lag: _PAST} if panel.setting.lag else {})
    found = {}
    for offset, names in offsets.items():
        errors = {
            row.method: runs_of(panel.records[row.method], "error", offset)
            for row in panel.rows
            if row.offset == offset
        }
        against = [method for name in names for method in errors if method.name == name]
        if against and len(errors) > 1:
            found[offset] = {
                method: {one: estimate(differences(own, errors[one])) for one in against}
                for method, own in errors.items()
            }
    return found
