"""Whether a localizer keeps the laws that the benchmarks rely on: ``check_localizer(name)``.

The command ``deqmcl check NAME`` prints the same; ``parametrize_with_laws`` makes it pytest tests.
"""

from localizers.checks.laws import LAWS, Law, Verdict
from localizers.checks.run import Report, check_localizer, parametrize_with_laws
from localizers.checks.subject import LawBrokenError, LawSkippedError

__all__ = [
    "LAWS",
    "Law",
    "LawBrokenError",
    "LawSkippedError",
    "Report",
    "Verdict",
    "check_localizer",
    "parametrize_with_laws",
]
