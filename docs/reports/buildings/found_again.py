"""Measure how a ``Tracker`` on two recorded logs gets lost, says so, and is found again.

``python docs/reports/buildings/found_again.py FOLDER`` writes found-again.csv beside it; FOLDER
holds the logs with their maps and references. Metres are of the odometry from the disturbance on,
seconds of the log's clock. ``--only calm,kidnapped`` runs these cases and keeps the other lines.
"""

import argparse
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.robots import replay_of
from benchmarks.tables.frames import csv_of
from deqmcl_gym.files import write_text
from deqmcl_gym.logs import Log
from deqmcl_gym.logs.motion import composed, one_pose, relative
from deqmcl_gym.numerics import Floats, Indices
from localizers import GaussianPrior, Relocalization, RobotModel, Tracker, make

REPORT = Path(__file__).resolve().with_name("found-again.csv")
LOGS = {"intel": 0.02, "freiburg-079": 0.05}  # the power that ``deqmcl replay`` fits to each
METHODS = {"mcl": None, "amcl": (0.0625, math.radians(3))}  # ``every``
RUNS, PLACES = 10, 10
NEAR, TURNED = 1.0, math.radians(30)
BEFORE, AFTER = 5.0, 35.0  # m that are played before a disturbance and after it
STAYS = 5.0  # m within 1 m and 30° after which a robot counts as found
LASTS = 60.0, 20.0  # s of a blackout and of a frozen lidar
LATE = 0.3  # s


@dataclass(frozen=True)
class Played:
    """Records in the order in which they are fed: of the log, with odometry of their own."""

    log: Log
    records: Indices
    odometry: Floats
    begins: int = 0  # of them, the first that is disturbed
    #: what becomes of the scan of one of them, (number, ranges, s since ``begins``); None: none
    scan: Callable[[int, Floats, float], Floats | None] = lambda k, ranges, since: ranges
    late: float = 0.0  # s
    start: tuple[float, float, float] | None = None  # wrong, as a person says it at ``begins``


@dataclass
class Course:
    """What a tracker said along a way; rows are its updates."""

    rows: Floats  # s, m since ``begins``, error m, error rad, lost, recoveries
    tracker: Tracker
    slowest: float  # s of the processor, of a scan
    hours: float

    @property
    def near(self) -> Floats:
        """Whether it is within 1 m and 30° of the reference."""
        near: Floats = (self.rows[:, 2] < NEAR) & (self.rows[:, 3] < TURNED)
        return near

    def found(self) -> tuple[float, float]:
        """Metres and seconds until it is near and stays so for 5 m; inf if never."""
        rows = self.rows[(self.rows[:, 1] >= 0) & ~np.isnan(self.rows[:, 2])]
        near = (rows[:, 2] < NEAR) & (rows[:, 3] < TURNED)
        for at in np.flatnonzero(near):
            ahead = (rows[:, 1] >= rows[at, 1]) & (rows[:, 1] <= rows[at, 1] + STAYS)
            if near[ahead].all() and rows[-1, 1] >= rows[at, 1] + STAYS:
                return float(rows[at, 1]), float(rows[at, 0])
        return math.inf, math.inf

    def said(self) -> float:
        """Metres until it says that it is lost; inf if it does not before it is found."""
        metres, _ = self.found()
        lost = (self.rows[:, 4] > 0) & (self.rows[:, 1] >= 0) & (self.rows[:, 1] <= metres)
        return float(self.rows[lost.argmax(), 1]) if lost.any() else math.inf

    def false(self) -> tuple[int, int]:
        """How often it said that it is lost, and was replaced, though it was near just before."""
        near = self.near[:-1]
        lost = np.diff(self.rows[:, 4]) > 0
        return int((lost & near).sum()), int(((np.diff(self.rows[:, 5]) > 0) & near).sum())


def driven(robot: RobotModel, method: str, played: Played, seed: int) -> Course:
    """Feed a tracker."""
    log = played.log
    recovery = Relocalization()
    tracker = Tracker(
        make(method, robot), np.random.default_rng(seed), every=METHODS[method], recovery=recovery
    )
    first = one_pose(log.reference[played.records[:1]])
    tracker.initialpose(GaussianPrior(mean=first, sd_position=0.2, sd_heading=0.1), 0.0)
    step = float(np.median(np.diff(log.times)))
    begun, rows, slowest = played.begins * step, [], 0.0
    ways = np.hypot(*np.diff(played.odometry[:, :2], axis=0, prepend=played.odometry[:1, :2]).T)
    ways = np.cumsum(ways) - ways[: played.begins + 1].sum()
    for k, (record, odometry) in enumerate(zip(played.records, played.odometry, strict=True)):
        now, before = k * step, time.process_time()
        if k == played.begins and played.start is not None:
            wrong = GaussianPrior(mean=played.start, sd_position=0.5, sd_heading=0.26)
            tracker.initialpose(wrong, now)
        ranges = log.ranges[record]
        if k >= played.begins:
            ranges = played.scan(k, ranges, now - begun)
        updated = tracker.odometry(now, odometry)
        if ranges is not None:
            updated |= tracker.scan(now + played.late, ranges)
        if k > 50:  # the first compile
            slowest = max(slowest, time.process_time() - before)
        if not updated:
            continue
        estimate, truth = tracker.at(), log.reference[record]
        off = np.array(estimate.pose) - truth
        error = math.hypot(off[0], off[1]), abs(math.remainder(off[2], 2 * math.pi))
        rows.append((now - begun, ways[k], *error, estimate.lost, tracker.counts.recoveries))
    return Course(np.array(rows, float), tracker, slowest, len(played.records) * step / 3600)


def whole(log: Log, **changed: Any) -> Played:
    """The log from its first reference pose on."""
    records = np.arange(log.referenced[0], len(log))
    return Played(log, records, log.odometry[records], **changed)


def stretch(log: Log, at: int, metres: float = AFTER, **changed: Any) -> Played:
    """From 5 m before a record to some metres after it."""
    first, last = np.searchsorted(log.driven, log.driven[at] + np.array([-BEFORE, metres]))
    first = log.referenced[np.searchsorted(log.referenced, first)]
    records = np.arange(first, min(last, len(log)))
    return Played(log, records, log.odometry[records], begins=at - int(first), **changed)


def carried(log: Log, i: int, j: int) -> Played:
    """Up to record i, then from record j on, while the odometry goes on."""
    before, after = stretch(log, i), stretch(log, j)
    here, there = before.records[: before.begins], after.records[after.begins :]
    moved = relative(log.odometry[[j]].repeat(len(there), axis=0), log.odometry[there])
    glued = composed(log.odometry[[i]].repeat(len(there), axis=0), moved)
    odometry = np.vstack([log.odometry[here], glued])
    return Played(log, np.concatenate([here, there]), odometry, begins=before.begins)


def places(log: Log, count: int, metres: float = AFTER) -> Indices:
    """Records with enough before and after them, drawn for good."""
    way, known = log.driven, log.referenced
    far = (way[known] > way[known[0]] + BEFORE) & (way[known] < way[-1] - metres)
    return np.random.default_rng(1).choice(known[far], count, replace=False)


def cases(log: Log, robot: RobotModel, chosen: list[str]) -> Iterator[tuple[str, list[Played]]]:
    """All that is played, by the name of the case."""
    pairs = [
        (i, j) for i, j in places(log, 4 * PLACES).reshape(-1, 2).tolist()
        if math.hypot(*(log.reference[i] - log.reference[j])[:2]) > 3
    ][:PLACES]  # fmt: skip
    some = [int(k) for k in places(log, PLACES)]
    rng = np.random.default_rng(2)

    def moved(at: int) -> tuple[float, float, float]:
        x, y, heading = log.reference[at].tolist()
        while True:
            turn = rng.uniform(0, 2 * math.pi)
            pose = x + 5 * math.cos(turn), y + 5 * math.sin(turn), heading
            if robot.floor_plan.free(np.array([pose]), robot.radius)[0]:
                return pose

    def blind(k: int, ranges: Floats, since: float) -> Floats | None:
        return None if since < LASTS[0] else ranges

    def frozen(at: int) -> Callable[[int, Floats, float], Floats | None]:
        return lambda k, ranges, since: log.ranges[at] if since < LASTS[1] else ranges

    def elsewhere(k: int) -> tuple[float, float, float]:
        return one_pose(log.reference[[some[(k + 1) % PLACES]]])

    every: dict[str, Callable[[], list[Played]]] = {
        "calm": lambda: [whole(log)] * RUNS,
        "kidnapped": lambda: [carried(log, i, j) for i, j in pairs],
        "5 m off": lambda: [stretch(log, at, start=moved(at)) for at in some],
        "another place": lambda: [
            stretch(log, at, start=elsewhere(k)) for k, at in enumerate(some)
        ],
        "blackout": lambda: [
            stretch(log, at, 2 * AFTER, scan=blind) for at in places(log, PLACES, 2 * AFTER)
        ],
        "frozen": lambda: [stretch(log, at, scan=frozen(at)) for at in some],
        "late": lambda: [whole(log, late=LATE)],
    }
    for name, made in every.items():
        if name in chosen:
            yield name, made()


def line(building: str, method: str, case: str, courses: list[Course]) -> dict[str, Any]:
    """One line of the table."""
    found = np.array([one.found() for one in courses])
    said = np.array([one.said() for one in courses])
    false = np.array([one.false() for one in courses]).sum(axis=0)
    hours = sum(one.hours for one in courses)
    near = np.concatenate([one.near[~np.isnan(one.rows[:, 2])] for one in courses])
    lost = np.concatenate([one.rows[~np.isnan(one.rows[:, 2]), 4] > 0 for one in courses])
    stayed = [one.near[~np.isnan(one.rows[:, 2])][-20:].mean() >= 0.95 for one in courses]
    counts = [one.tracker.counts for one in courses]
    last = [one.tracker.stamps_late_by for one in courses]
    return {
        "building": building, "method": method, "case": case, "runs": len(courses),
        "found": int(np.isfinite(found[:, 0]).sum()), "stayed": int(sum(stayed)),
        "metres": np.median(found[:, 0]), "most": found[:, 0].max(),
        "seconds": np.median(found[:, 1]), "said": np.median(said),
        "error": np.median(np.concatenate([one.rows[:, 2][one.near] for one in courses])),
        "lost": 1 - near.mean(), "missed": (~lost & ~near).sum() / max((~near).sum(), 1),
        "false_lost": (lost & near).sum() / near.sum(), "false_lost_an_hour": false[0] / hours,
        "hours": hours, "recoveries": sum(one.recoveries for one in counts),
        "false_recoveries": int(false[1]), "frozen": sum(one.frozen_scans for one in counts),
        "misdated": sum(one.misdated_scans for one in counts),
        "updates": sum(one.updates for one in counts),
        "late_by": np.median(last), "slowest": max(one.slowest for one in courses),
    }  # fmt: skip


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--only", default="calm,kidnapped,5 m off,another place,blackout,frozen,late"
    )
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--logs", default=",".join(LOGS))
    given = parser.parse_args()
    for name in given.logs.split(","):
        replay = replay_of(
            given.folder / f"{name}.log.gz", given.folder / f"{name}.yaml",
            reference=given.folder / f"{name}.reference.tum",
            settings={"assumed.scan.power": LOGS[name]},
        )  # fmt: skip
        setup = replay.scenario
        robot, log = setup.robot_model(setup.room()), setup.whole.with_beams(60)
        for case, all_played in cases(log, robot, given.only.split(",")):
            for method in given.methods.split(","):
                courses = [driven(robot, method, one, k) for k, one in enumerate(all_played)]
                row = pd.DataFrame([line(name, method, case, courses)]).round(4)
                print(row.T.to_string(header=False), flush=True)
                if REPORT.exists():
                    former = pd.read_csv(REPORT)
                    key = ["building", "method", "case"]
                    row = pd.concat([former, row]).drop_duplicates(key, keep="last")
                write_text(REPORT, csv_of(row))


if __name__ == "__main__":
    main()
