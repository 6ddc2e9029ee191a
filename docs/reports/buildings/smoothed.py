"""Measure ``deqmcl smooth`` against references that it does not see.

``python docs/reports/buildings/smoothed.py DATA OUT`` writes smoothed.csv beside it. DATA holds the
logs, maps and references of two buildings, OUT keeps what was run. All is at the references' own
times; the 95 % intervals are of 20 stretches of a log, drawn with replacement.

smoothed-tuned.csv has ``amcl`` on the true reference, 2 runs each, by ``deqmcl replay LOG --map MAP
--reference TRUE --localizers amcl --seeds 2 --nav2 nav2.yaml``, which ``deqmcl tune LOG --map MAP
--reference REFERENCE --candidates 36`` has written for the smoothed and for the true poses; in
freiburg-079 they are the same file.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.cli import main
from benchmarks.robots.estimates import at_own_times
from benchmarks.tables.frames import csv_of
from benchmarks.trials.tracks import calibration_of_gaussians
from deqmcl_gym.files import write_text
from deqmcl_gym.logs import read_tum
from deqmcl_gym.logs.trajectory import read_estimate
from deqmcl_gym.numerics import arrays

REPORT = Path(__file__).resolve().parent
BUILDINGS = ("freiburg-079", "intel")
STARTS = {"known": "0,0,0", "global": "global"}
STRETCHES, DRAWS = 20, 2000


def smoothed(files: dict[str, str], start: str, out: Path) -> dict[str, object]:
    """Smoothed poses against the reference."""
    if not (out / "smoothed.csv").exists():
        main(["smooth", files["log"], "--map", files["map"], f"--start={start}", "--out", str(out)])
    estimate, reference = read_estimate(out / "smoothed.csv"), read_tum(files["reference"])
    track, at = at_own_times(estimate, reference)
    own = track.at_stamps
    truth, spread = track.log.reference, estimate.covariances[at]
    off = truth - track.best
    off[:, 2] = arrays.wrapped(off[:, 2])
    rank, nees, _ = calibration_of_gaussians(off, spread, "m")[own].T
    distance, angle = track.errors.translation[own], track.errors.rotation[own]
    figures = {
        "position_median": lambda k: np.median(distance[k]),
        "position_p95": lambda k: np.quantile(distance[k], 0.95),
        "heading_median": lambda k: np.degrees(np.median(angle[k])),
        "heading_p95": lambda k: np.degrees(np.quantile(angle[k], 0.95)),
        **{f"coverage_{p}": lambda k, p=p: (rank[k] <= p / 100).mean() for p in (50, 80, 95)},
        "nees": lambda k: nees[k].mean(),
    }
    rng, every = np.random.default_rng(0), np.arange(own.size)
    parts = np.array_split(every, STRETCHES)
    drawn = [np.concatenate([parts[k] for k in rng.integers(STRETCHES, size=STRETCHES)])
             for _ in range(DRAWS)]  # fmt: skip
    row: dict[str, object] = {"records": own.size}
    for name, of in figures.items():
        low, high = np.quantile([of(k) for k in drawn], (0.025, 0.975))
        row |= {name: of(every), f"{name}_low": low, f"{name}_high": high}
    return row


def measure(data: Path, out: Path) -> None:
    """Write the table, row by row."""
    rows = []
    for building in BUILDINGS:
        ends = {"log": ".log.gz", "map": ".yaml", "reference": ".reference.tum"}
        files = {name: str(data / f"{building}{end}") for name, end in ends.items()}
        for start, words in STARTS.items():
            row = smoothed(files, words, out / f"{building}-{start}")
            rows.append({"building": building, "start": start} | row)
            write_text(REPORT / "smoothed.csv", csv_of(pd.DataFrame(rows)))


if __name__ == "__main__":
    measure(Path(sys.argv[1]), Path(sys.argv[2]))
