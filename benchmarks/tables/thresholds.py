"""When an estimate is far off and a trial lost, as the records of the trials say."""

from dataclasses import dataclass

from benchmarks.tables.pairing import Record


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """The thresholds that a table names.

    Attributes:
        far: e above which a step is far off.
        lost: position error above which a trial is lost, on average over its last states.
        lost_steps: how many states these are.
        unit: of lengths.
    """

    far: float
    lost: float
    lost_steps: int
    unit: str

    @property
    def far_words(self) -> str:
        """In words: e > 50 px."""
        return f"e > {self.far:g} {self.unit}"


def thresholds_of(record: Record) -> Thresholds:
    """Return the thresholds that a finished trial was scored with."""
    return Thresholds(unit=record["unit"], **record["thresholds"])
