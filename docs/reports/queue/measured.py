"""Measure the paper's queue against the sharpness of the sensor, and what mends it.

``python docs/reports/queue/measured.py FOLDER`` writes rooms.csv and logs.csv beside it, and
docs/figures/queue.svg; FOLDER holds the two logs with their maps and references, and
freiburg-signed.csv.gz if it is to be among them. ``--draw`` only draws.
"""

import argparse
import csv
import math
import os
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.report.charts import Chart, canvas, line, styled
from benchmarks.robots import replay_of
from benchmarks.tables.frames import csv_of
from benchmarks.trials import Trial
from benchmarks.trials.episode import Step
from benchmarks.trials.stage import Stage
from benchmarks.trials.trace import Trace
from deqmcl_gym.files import write_text

REPORT = Path(__file__).resolve().parent
FIGURE = REPORT.parents[1] / "figures" / "queue.svg"
LAGS, LAG = (0, 1, 2, 3, 5, 10, 20), 20
WORLDS = 20
SENSORS = {  # words: beams, σ in px
    "1 beam, σ = 100 px": (1, 100.0),
    "9 beams, σ = 50 px": (9, 50.0),
    "9 beams, σ = 20 px": (9, 20.0),
    "9 beams, σ = 5 px": (9, 5.0),
    "36 beams, σ = 5 px": (36, 5.0),
}
SHARP = "9 beams, σ = 5 px"
NOISES = {  # σ_dd, σ_φφ, σ_φd per px that the filter assumes: those of the world, `sharp`, `paper`
    "0.02": (0.02, 0.02, 0.0005),
    "0.1": (0.1, 0.1, 0.01),
    "0.2": (0.2, 0.3, 0.05),
}
LOGS = {  # the power that ``deqmcl replay`` fits to each
    "intel": ("intel", 0.02),
    "freiburg-079": ("freiburg-079", 0.05),
    "freiburg-signed": ("freiburg-079", 0.05),
}
METHODS = (  # on logs at lag 20: name, parameters, runs
    ("mcl", {}, 10),
    ("mcl-smoother", {}, 10),
    ("deq-mcl-fresh", {}, 10),
    ("deq-mcl-fresh", {"evidence": "plan"}, 3),
    ("deq-mcl", {}, 3),
)
COLUMNS = (
    "setting", "method", "params", "noise", "particles", "lag", "runs", "ancestors", "error",
    "error_p95", "past", "future", "localized", "future_50", "future_80", "future_95",
    "future_energy",
)  # fmt: skip

_OF_RUNS = ("ancestors", "error", "error_p95", "past", "future")  # their median over runs on a log


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One line of a table: a method in a setting, over some worlds or runs."""

    setting: str
    scenario: str
    world: Mapping[str, Any]
    assumed: Mapping[str, Any]
    method: str
    runs: int
    lag: int
    noise: str = ""
    params: dict[str, Any] = field(default_factory=dict)

    def trials(self) -> list[Trial]:
        """Its trials: other worlds of a room, other runs on a log."""
        own = {} if self.method == "mcl" else {"lag": self.lag}
        params = {"particles": 1_000, **own, **self.params}
        fixed = {
            "scenario": self.scenario, "world": self.world, "assumed": self.assumed, "seed": 0,
            "localizer": self.method, "params": params, "lag": self.lag,
        }  # fmt: skip
        return [Trial(trial=k, **fixed) for k in range(self.runs)]


def rooms() -> list[Cell]:
    """The published queue on a lap with a plan made before the start, over its lag."""
    varied = [(words, "0.02", 1_000) for words in SENSORS]
    varied += [(SHARP, noise, 1_000) for noise in ("0.1", "0.2")]
    varied += [(SHARP, "0.02", particles) for particles in (300, 10_000)]
    cells = []
    for (words, noise, particles), lag in product(varied, LAGS):
        beams, sigma = SENSORS[words]
        world = {"lidar.beams": beams, "lidar.sigma": sigma, "lidar.field_of_view": math.pi / 2}
        named = zip(("drive", "turn", "drift"), NOISES[noise], strict=True)
        assumed = {f"motion.{name}": value for name, value in named}
        cells.append(
            Cell(
                setting=words, scenario="matched", world=world, lag=lag, noise=noise, runs=WORLDS,
                assumed={**assumed, "scan.sigma": "world"}, method="deq-mcl",
                params={"particles": particles},
            )
        )  # fmt: skip
    return cells


def logs(folder: Path) -> list[Cell]:
    """The published queue on real logs over its lag, and what mends it at the default lag."""
    cells = []
    for name, (place, power) in LOGS.items():
        log = folder / f"{name}.{'csv' if name == 'freiburg-signed' else 'log'}.gz"
        if not log.exists():
            continue
        floor_plan, reference = folder / f"{place}.yaml", folder / f"{place}.reference.tum"
        tempered = {"assumed.scan.power": power}
        replay = replay_of(log, floor_plan, reference=reference, settings=tempered)
        setting = {
            "setting": name, "scenario": "replay", "world": replay.world, "assumed": replay.assumed
        }  # fmt: skip
        cells += [Cell(**setting, method="deq-mcl", lag=lag, runs=3) for lag in LAGS[:-1]]
        cells += [Cell(**setting, method=m, params=p, lag=LAG, runs=n) for m, p, n in METHODS]
    return cells


def measured(trial: Trial) -> tuple[Trace, float]:
    """Run a trial; return its trace, and the median number of distinct x_t when o_t arrives."""
    stage, counts = Stage.of(trial), []

    def counted() -> Iterator[Step]:
        for moment in stage.moments():
            if moment.t > 0:
                points, _ = moment.belief.points()
                counts.append(np.unique(points[:, 0]).size)
            yield moment

    trace = Trace(counted(), trial.offsets, stage.task)
    return trace, float(np.median(counts))


def scores(trial: Trial) -> dict[str, float]:
    """Return the errors in (x, y) at x[t], x[t-L] and x[t+L], and how the last one is covered."""
    trace, ancestors = measured(trial)
    in_metres = trace.task.floor_plan.unit == "m"
    metre, middle = (1.0, np.median) if in_metres else (50.0, np.mean)
    found = {"ancestors": ancestors}
    for offset, column in ((0, "error"), (-trial.lag, "past"), (trial.lag, "future")):
        if (own := trace.offsets.get(offset)) is None:
            continue
        own = own.scored
        away = np.hypot(*(own.means[:, :2] - own.truth[:, :2]).T)
        found[column] = float(middle(away))
        if offset == 0:
            last = away[-(away.size // 4) :]
            found["error_p95"] = float(np.quantile(away, 0.95))
            found["localized"] = float((last < metre).mean() >= 0.95)
        elif offset == trial.lag:
            rank = own.values["rank"]
            for level in (50, 80, 95):
                found[f"future_{level}"] = float((rank <= level / 100).mean())
            found["future_energy"] = float(own.values["energy"].mean())
    return found


def table(cells: list[Cell], jobs: int) -> str:
    """Run all trials; return a line a cell, means over its runs."""
    with ProcessPoolExecutor(jobs) as pool:
        pending = [[pool.submit(scores, trial) for trial in cell.trials()] for cell in cells]
        lines = [
            _line(cell, [one.result() for one in own])
            for cell, own in zip(cells, pending, strict=True)
        ]
    return csv_of(pd.DataFrame(lines, columns=COLUMNS))


def _line(cell: Cell, found: list[dict[str, float]]) -> list[str]:
    print(cell.setting, cell.method, cell.params, cell.lag, found[0], flush=True)
    params = {name: value for name, value in cell.params.items() if name != "particles"}
    said: dict[str, Any] = {
        "setting": cell.setting, "method": cell.method, "lag": cell.lag, "runs": len(found),
        "params": " ".join(f"{k}={v}" for k, v in params.items()),
        "particles": cell.params.get("particles", 1_000),
        "noise": cell.noise,
    }  # fmt: skip
    for name in COLUMNS[7:]:
        values = [one[name] for one in found if name in one]
        # one lost run is most of a mean; of how many are lost, and of calibration, it is the figure
        middle = np.median if name in _OF_RUNS and cell.scenario == "replay" else np.mean
        said[name] = f"{middle(values):.6g}" if values else ""
    return [str(said[name]) for name in COLUMNS]


def _rows(name: str) -> list[dict[str, str]]:
    with (REPORT / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def chart() -> Chart:
    """Draw how many distinct x_t there are when o_t arrives, over the lag."""
    lines = [(words, "rooms") for words in SENSORS] + [(name, "logs") for name in LOGS]
    frame = pd.DataFrame(
        {"label": words, "lag": int(row["lag"]), "ancestors": float(row["ancestors"])}
        for words, report in lines
        for row in _rows(report)
        if row["setting"] == words and row["method"] == "deq-mcl"
        and row["noise"] in ("", "0.02") and row["particles"] == "1000"
    )  # fmt: skip
    with styled():
        axes = line(frame, "lag", "ancestors", axes=canvas(6.4, 3.4))
        axes.set_yscale("log")
        axes.yaxis.minorticks_off()
        ticks = (1, 3, 10, 30, 100, 300, 1000)
        axes.set_yticks(ticks, [f"{tick:,}" for tick in ticks])
        axes.set_xticks([0, 5, 10, 15, 20])
        axes.set(xlabel="lag L, steps", ylabel="distinct x[t] of 1,000 particles")
        title = "The published queue loses its particles"
        return Chart("queue", title, "", axes.figure)


def main() -> int:
    """Measure, write, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of the logs")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--draw", action="store_true", help="only draw")
    parser.add_argument("--only", choices=["rooms", "logs"])
    given = parser.parse_args()
    if not given.draw:
        parts = {"rooms": rooms, "logs": lambda: logs(given.folder)}
        for name in [given.only] if given.only else parts:
            write_text(REPORT / f"{name}.csv", table(parts[name](), given.jobs))
    write_text(FIGURE, chart().drawn("svg").decode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
