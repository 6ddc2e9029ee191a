"""published.csv: what believed and published covariances are worth, on records not fitted to.

    python docs/reports/buildings/published.py NAME=FOLDER… > docs/reports/buildings/published.csv

A folder is one of ``deqmcl replay``, of which the first localizer counts. Errors, too, are those of
the later records, of all runs; the numbers of calibrations are medians over runs.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.report.tracks import tracked
from benchmarks.setup.overrides import file_names
from benchmarks.sweeps.results import results_in
from benchmarks.trials.scores import CALIBRATION, published_scores
from benchmarks.trials.trace import calibration_of
from localizers import Calibration


def rows_of(name: str, folder: str) -> list[dict[str, object]]:
    """Return two rows: as believed, and as published."""
    (panel,) = results_in(Path(folder)).panels
    runs, _ = tracked(panel)
    judged = panel.setting.world["judged"]
    runs = runs[runs["label"] == runs["label"].iloc[0]]
    tracks = list(runs["track"])
    errors = np.concatenate([track.errors.translation[track.known >= judged] for track in tracks])
    shared = {
        "building": file_names(panel.setting.world["log"]).partition(".")[0],
        "name": name,
        "power": panel.setting.assumed.get("scan.power"),
        "runs": len(runs),
        "success_1m": runs["success_1m"].mean(),
        "position_median": np.median(errors),
        "position_p95": np.quantile(errors, 0.95),
    }
    rows = []
    for which in ("believed", "published"):
        each = []
        for track in tracks:
            by = Calibration() if which == "believed" else calibration_of(track, judged)
            each.append(published_scores(track, judged, by) | vars(by))
        frame = pd.DataFrame(each)
        numbers = {"covariance": which, **frame.drop(columns=list(CALIBRATION)).mean()}
        numbers |= {f"calibration_{part}": frame[part].median() for part in CALIBRATION}
        rows.append(shared | numbers)
    return rows


if __name__ == "__main__":
    table = pd.DataFrame([row for word in sys.argv[1:] for row in rows_of(*word.split("=", 1))])
    print(table.to_csv(index=False, float_format="%.6g"), end="")
