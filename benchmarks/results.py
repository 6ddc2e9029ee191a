"""What a sweep hands to its report: records of finished trials, failures, and what is missing."""

from dataclasses import dataclass
from typing import Any


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

    Trials of the same setting (preset, world, assumed, disturbance, lag, seed) and the same number
    are paired over methods (localizer, params).

    Attributes:
        title: of the sweep.
        records: finished trials in the sweep's order, as the store keeps them: ``trial``,
            ``scores``, ``curves``, ``quality``, ``steps_done``, ``scans_used``, ``events``,
            ``seconds``.
        failures: trials that failed, in the sweep's order.
        missing: trials that neither finished nor failed yet.
        planned: distinct trials asked for.
        command: the words that started the sweep.
        environment: versions and code, see ``provenance.environment``.
    """

    title: str
    records: list[dict[str, Any]]
    failures: list[Failure]
    missing: int
    planned: int
    command: list[str]
    environment: dict[str, Any]
