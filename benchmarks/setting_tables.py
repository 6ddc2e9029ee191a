"""The tables of a sweep: those of one setting, each line led by what the setting and method are."""

import csv
import io
import json
from collections.abc import Callable, Sequence
from typing import Any

from benchmarks.tables import Record, table_csv, table_rows, timings_csv, trials_csv

_LEADING = ("preset", "world", "assumed", "disturbance", "lag", "seed", "params")


def results_csv(records: Sequence[Record]) -> str:
    """One line per setting, method and offset, averaged over trials."""
    return _led(records, lambda own: table_csv(table_rows(own)))


def sweep_trials_csv(records: Sequence[Record]) -> str:
    """One line per trial and offset."""
    return _led(records, trials_csv)


def sweep_timings_csv(records: Sequence[Record]) -> str:
    """One line per trial."""
    return _led(records, timings_csv)


def _led(records: Sequence[Record], table: Callable[[Sequence[Record]], str]) -> str:
    groups: dict[tuple[str, ...], list[Record]] = {}
    for record in records:
        lead = tuple(_text(record["trial"][name]) for name in _LEADING)
        groups.setdefault((*lead, record["trial"]["localizer"]), []).append(record)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    for lead, own in groups.items():
        header, *lines = csv.reader(io.StringIO(table(own)))
        if out.tell() == 0:
            writer.writerow([*_LEADING, *header])
        writer.writerows([*lead[:-1], *line] for line in lines)
    return out.getvalue()


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, sort_keys=True)
