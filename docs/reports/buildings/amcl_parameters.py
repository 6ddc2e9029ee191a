"""What each parameter of a tuned AMCL gives, on segments of logs that the search did not see.

``python docs/reports/buildings/amcl_parameters.py FOLDER [NAV2.yaml]`` writes amcl-parameters.csv
beside it, by the file of `deqmcl tune` (nav2-both.yaml): Nav2's defaults with one parameter of the
file, and the file without one. FOLDER holds both logs with their maps and references.
"""

import sys
from pathlib import Path

import pandas as pd

from benchmarks.robots import replay_of
from benchmarks.robots.nav2 import read_nav2, usual_params
from benchmarks.robots.search import RUNS, Task, cut
from benchmarks.setup.overrides import NOTHING, Overrides
from benchmarks.tables.frames import csv_of
from benchmarks.tables.stats import estimate
from benchmarks.trials.stage import attempt, key_of

HERE = Path(__file__).resolve().parent
BUILDINGS = ("freiburg-079", "intel")
PLAYED = {"world.every": "0.05m,3deg", "world.max_beams": 180}  # as tune plays logs to amcl
SCORES = ("position_median", "position_p95", "within_1m", "coverage_95", "nees", "log_score")
FEW = ("laser_model_type", "sigma_hit", "max_beams", "update_min_d", "update_min_a")


def parameter_sets(tuned: Path) -> dict[str, Overrides]:
    """Return what is changed of Nav2's defaults, by name."""
    usual, own = usual_params(), read_nav2(tuned).params
    best = {name: value for name, value in own.items() if value != usual[name]}
    best.pop("z_rand", None)  # goes with z_hit
    sets = {"default": {}, "tuned": best, "few": {name: best[name] for name in FEW}}
    sets |= {f"with {name}": {name: value} for name, value in best.items()}
    for name in best:
        sets[f"without {name}"] = {n: value for n, value in best.items() if n != name}
    return {name: Overrides(values) for name, values in sets.items()}


def runs_of(folder: Path, sets: dict[str, Overrides]) -> pd.DataFrame:
    """Return the runs of each set on each held-out segment."""
    replays = [
        replay_of(
            folder / f"{name}.log.gz",
            folder / f"{name}.yaml",
            reference=folder / f"{name}.reference.tum",
            settings=PLAYED,
        )
        for name in BUILDINGS
    ]
    training, held_out = cut(replays, 15.0, 2.0, (0.2, 0.1), 0)
    task = Task(
        localizer="amcl",
        score="log-score",
        max_ms=None,
        seed=0,
        base=NOTHING,
        usual=NOTHING,
        space={},
        training=training,
        held_out=held_out,
    )
    rows = []
    for name, values in sets.items():
        for segment in held_out:
            building = Path(segment.whole["log"]).name.removesuffix(".log.gz")
            for run in range(RUNS):
                trial = task.trial(values, segment, run)
                record = attempt(trial, key_of(trial)).record
                assert record is not None
                assert record.track is not None
                scores = {score: record.track.scores[score] for score in SCORES}
                rows.append({"which": name, "log": building, "segment": segment.number, **scores})
    return pd.DataFrame(rows)


def table_of(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a row per set and building, with its log score less that of the defaults."""
    rows = []
    for building in (*BUILDINGS, "both"):
        part = runs if building == "both" else runs[runs["log"] == building]
        segments = part.groupby(["which", "log", "segment"], sort=False)[[*SCORES]].mean()
        default = segments.xs("default")["log_score"]
        for name in runs["which"].unique():
            own = segments.xs(name)
            gain = estimate((own["log_score"] - default).to_numpy())
            ends = {"gain": gain.mean, "gain_low": gain.low, "gain_high": gain.high}
            rows.append({"parameters": name, "building": building, **own.mean(), **ends})
    return pd.DataFrame(rows).round(4)


if __name__ == "__main__":
    folder, tuned = Path(sys.argv[1]), Path(*sys.argv[2:] or [HERE / "nav2-both.yaml"])
    table = table_of(runs_of(folder, parameter_sets(tuned)))
    (HERE / "amcl-parameters.csv").write_text(csv_of(table))
