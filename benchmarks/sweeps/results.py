"""Results: what a report is made of: records of finished trials, failures, and what is missing."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from benchmarks.tables.gap import LimitRuns
from benchmarks.tables.pairing import BASELINE
from benchmarks.tables.panels import Panel, panels


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A trial that could not be finished.

    Attributes:
        trial: ``Trial.canonical()``.
        reason: why, in one sentence.
    """

    trial: dict[str, Any]
    reason: str


@dataclass(frozen=True, kw_only=True)
class Results:
    """A sweep as far as it has come.

    Trials of the same setting (scenario, world, assumed, disturbance, lag, seed) and the same
    number are paired over methods (localizer, params).

    Attributes:
        title: of the sweep.
        records: finished trials in the sweep's order, as the store keeps them: ``trial``,
            ``scores``, ``curves``, ``quality``, ``steps_done``, ``scans_used``, ``events``,
            ``key``, ``seconds``.
        limits: those of the sweep's limits, which are only what gaps are measured from.
        baseline: localizer that the others are compared with.
        failures: trials that failed, in the sweep's order.
        missing: trials that neither finished nor failed yet.
        planned: distinct trials asked for.
        command: the words that started the sweep.
        environment: versions and code, see ``provenance.environment``.
        verified: what other code got the same results, in words.
        left_out: files of the folder that are in no table, and why.
    """

    title: str
    records: list[dict[str, Any]]
    failures: list[Failure]
    missing: int
    planned: int
    command: list[str]
    environment: dict[str, Any]
    limits: list[LimitRuns] = field(default_factory=list)
    baseline: str = BASELINE
    verified: list[str] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)

    @cached_property
    def panels(self) -> list[Panel]:
        """The methods of every setting, compared: all intervals and tests, computed once."""
        failed = [failure.trial for failure in self.failures]
        return panels(self.records, self.baseline, self.limits, failed)

    @property
    def made_by(self) -> str:
        """Whose numbers these are, in a sentence; "" if only one code has made them."""
        code = str(self.environment.get("code", ""))[:12]
        return f"Made by code {code}, {'; '.join(self.verified)}." if self.verified else ""

    @property
    def finished(self) -> list[dict[str, Any]]:
        """All finished trials; one that is a limit's, too, once."""
        limits = (record for limit in self.limits for record in limit.records)
        return list({id(record): record for record in (*self.records, *limits)}.values())
