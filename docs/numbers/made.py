"""Which code made each report, and which has been seen to get the same numbers since.

``docs/reports/made.toml`` has a table for each run. ``make reports`` writes it, but for
``accepted``, which only people write. A report is stale if the code, or the design of its sweep, is
not what made it or was verified. One that is accepted stands as it is, and the page says why.
"""

import json
import tomllib
from collections.abc import Mapping
from typing import Any

from msgspec import Struct, convert, to_builtins

from deqmcl_gym.files import write_text
from docs.numbers.reading import ROOT, table

REPORTS = ROOT / "docs" / "reports"
NAME = "made.toml"
_HEAD = """\
# Which code made the reports. `make reports` writes this file; only `accepted` is written by hand:
# accepted = { "on" = "2026-11-23", "reason" = "why numbers of other code may be quoted" }
"""
_DIGITS = 12  # of a digest


class Verified(Struct, frozen=True):
    """Other code that got the same records in all the trials that are kept as a sample."""

    code: str
    on: str
    trials: int


class Accepted(Struct, frozen=True):
    """Why a report of other code may be quoted; the reason ends without a full stop."""

    on: str
    reason: str


class Report(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What is committed of one run.

    Attributes:
        command: the words after ``deqmcl``, without --out; or, in words, how it is made by hand.
        files: committed files, in docs/reports, by those of the run's folder they come from.
        code: digest of the code that made it; of one made before this list, of the commit that
            brought it.
        on: the date.
        design: digest of the sweep without its title; "" if it was not kept.
        libraries: versions by name.
        trials: how many.
        minutes: on two cores; 0 where nobody knows.
        verified: the last code that was verified.
        accepted: that it stands as it is.
    """

    command: str
    files: dict[str, str]
    code: str
    on: str
    design: str = ""
    libraries: dict[str, str] = {}
    trials: int = 0
    minutes: float = 0.0
    verified: Verified | None = None
    accepted: Accepted | None = None

    def stale(self, code: str, design: str) -> str:
        """Say why it is not known to have the numbers of this code and design; "" if it is."""
        if self.design and self.design != design:
            return "its sweep has changed"
        known = [self.code, *([self.verified.code] if self.verified else [])]
        if code in known:
            return ""
        return f"of code {self.code[:_DIGITS]}, this is {code[:_DIGITS]}"


def read() -> dict[str, Report]:
    """Return the reports by name."""
    content = tomllib.loads((REPORTS / NAME).read_text(encoding="utf-8"))
    return convert(content, dict[str, Report])


def write(reports: Mapping[str, Report]) -> None:
    """Write the reports, in their order."""
    parts = [_HEAD]
    for name, report in reports.items():
        lines = (f"{key} = {_toml(value)}\n" for key, value in to_builtins(report).items())
        parts.append(f"[{name}]\n{''.join(lines)}")
    write_text(REPORTS / NAME, "\n".join(parts))


def _toml(value: Any) -> str:
    """Return a value on one line; a text of JSON is one of TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_toml(key)} = {_toml(own)}' for key, own in value.items())} }}"
    return json.dumps(value, ensure_ascii=False)


def _made() -> str:
    rows = []
    for report in read().values():
        files = ", ".join(f"[{file}]({file})" for file in report.files)
        checked, accepted = report.verified, report.accepted
        rows.append([
            files,
            f"{report.code[:_DIGITS]}, {report.on}",
            f"{checked.code[:_DIGITS]}, {checked.on}: {checked.trials} trials" if checked else "",
            f"{accepted.on}: {accepted.reason}" if accepted else "",
        ])  # fmt: skip
    head = "files | code that made them | code verified since | accepted as they are"
    return table(head, rows)


TABLES = {"reports": _made}
