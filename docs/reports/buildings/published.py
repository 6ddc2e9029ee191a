"""published.csv: what believed and published covariances are worth, on records not fitted to.

    python docs/reports/buildings/published.py FOLDER… > docs/reports/buildings/published.csv

A folder is one of ``deqmcl replay``. Errors, too, are those of the later records, of all runs.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.report.tracks import tracked
from benchmarks.setup.overrides import file_names
from benchmarks.sweeps.results import results_in
from benchmarks.trials.scores import CALIBRATION, published_scores
from localizers import Calibration


def rows_of(folder: Path) -> list[dict[str, object]]:
    """Return two rows for each localizer: as believed, and as published."""
    (panel,) = results_in(folder).panels
    runs, _ = tracked(panel)
    judged = panel.setting.world["judged"]
    shared = {
        "building": file_names(panel.setting.world["log"]).partition(".")[0],
        "power": panel.setting.assumed.get("scan.power"),
    }
    rows = []
    for label, own in runs.groupby("label", sort=False):
        errors = np.concatenate(
            [track.errors.translation[track.known >= judged] for track in own["track"]]
        )
        held = {
            "runs": len(own),
            "success_1m": own["success_1m"].mean(),
            "position_median": np.median(errors),
            "position_p95": np.quantile(errors, 0.95),
        }
        for which in ("believed", "published"):
            each = []
            for track in own["track"]:
                by = Calibration() if which == "believed" else track.calibration(judged)
                each.append(published_scores(track, by, judged) | vars(by))
            mean, middle = pd.DataFrame(each).mean(), pd.DataFrame(each).median()
            numbers = {name: mean[name] for name in mean.index if name not in CALIBRATION}
            numbers |= {f"calibration_{name}": middle[name] for name in CALIBRATION}
            rows.append({**shared, "localizer": label, "covariance": which, **held, **numbers})
    return rows


if __name__ == "__main__":
    table = pd.DataFrame([row for folder in sys.argv[1:] for row in rows_of(Path(folder))])
    print(table.to_csv(index=False, float_format="%.6g"), end="")
