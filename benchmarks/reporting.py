"""What stands in the folder of a sweep when it ends."""

from pathlib import Path

from benchmarks.results import Results
from benchmarks.setting_tables import results_csv, sweep_timings_csv, sweep_trials_csv
from benchmarks.store import write_text


def write_report(out: Path, results: Results) -> list[Path]:
    """Write the tables of a sweep; return their files."""
    texts = {
        "results.csv": results_csv(results.records),
        "trials.csv": sweep_trials_csv(results.records),
        "timings.csv": sweep_timings_csv(results.records),
    }
    for name, text in texts.items():
        write_text(out / name, text)
    return [out / name for name in texts]
