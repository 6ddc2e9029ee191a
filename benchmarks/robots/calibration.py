"""What is fitted to a log: the power of its scans, and what seems wrong with it or its map.

Beams are not independent, so p(o | x, m)^power needs a power below 1 (Thrun, Burgard & Fox 2005,
section 6.3.4): here the one with which the filter is most exact; the calibration sees to it that
the region holds. Clocks, the lidar's mounting and the wheels are fits of few numbers, with standard
errors by the gradients of ten stretches of the log (White 1982). A fault is reported if it exceeds
what nobody can tell by four standard errors: the period of the records, a cell of the map, half a
cell per m.
"""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from benchmarks.console import doing
from benchmarks.robots import SCENARIO, Replay
from benchmarks.setup.logs import LogScenario
from benchmarks.setup.overrides import Overrides, located
from benchmarks.tables import percent
from benchmarks.trials import Trial
from benchmarks.trials.stage import Stage
from benchmarks.trials.trace import TrackLog
from benchmarks.trials.tracks import AGREE, agreement, calibration_of_gaussians
from deqmcl_gym.logs import Log, LogWarning, Scanner, read_tum
from deqmcl_gym.logs.motion import increments_of, lengths_of
from deqmcl_gym.maps import GridMap, Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Floats, arrays
from localizers import Calibration

PART = 0.3  # of the records, the first ones: fitted on; the rest judges
_MOST = 800  # of them: two seconds of a filter for each power that is tried
_ENOUGH = 100  # records with a reference, fewer say nothing of 95 %
_PARTICLES = 1000
_POWERS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
_NEAR = 1.0  # m: a filter farther off follows nothing
_ROOT = 25  # of the randomness: a fit is the same for every --seed


def with_fitted_power(replay: Replay) -> Replay:
    """Return what is played with the power that is fitted to its first part, if none is set.

    That of the least log score of what ``mcl`` publishes, calibrated, of those with which it
    follows the robot: a region too narrow or too wide costs nothing there, only errors do.
    """
    if "scan.power" in replay.assumed:
        return replay
    log, judged = replay.log, first_judged(replay.log)
    if judged is None:
        words = (
            f"The power is 1: not fitted, which needs {_ENOUGH} records with a reference in the "
            f"first {PART:.0%} of the log; a smaller --every gives more. Nor are covariances "
            "calibrated: coverage, NEES and log score are of what is believed."
        )
        return replace(replay, power=words)
    first, whole = log.referenced[0], replay.scenario.whole
    same = (whole.times == log.times[first]) & (whole.odometry == log.odometry[first]).all(axis=1)
    count = min(judged - int(first), _MOST)
    assumed = {name: v for name, v in replay.assumed.items() if not name.startswith("prior.")}
    world = {name: v for name, v in replay.world.items() if name != "judged"}
    world["start"] = int(np.flatnonzero(same)[0])
    with doing("fitting the power of the scan model to the first part of the log"):
        with_power = {power: Overrides(assumed | {"scan.power": power}) for power in _POWERS}
        tried = {power: _measured(world, noise, count) for power, noise in with_power.items()}
    scores = {power: score for power, (score, error) in tried.items() if error <= _NEAR}
    if not scores:
        words = (
            f"With no power of a scan's likelihood from {min(_POWERS)} to 1 does mcl "
            f"follow the robot in the first {count:,} records, so none is fitted and 1 is kept: "
            "errors and regions of methods that use it say little. Check map, mounting and start."
        )
        return replace(replay, power=words)
    power = min(scores, key=scores.__getitem__)
    words = (
        f"The likelihood of a scan is raised to the power {power:g}, the best of {len(_POWERS)} by "
        f"the log score of what mcl publishes in the first {count:,} records, calibrated; with it, "
        f"95 % of its errors there are below {tried[power][1]:.2f} m."
    )
    return replace(replay, assumed=replay.assumed | {"scan.power": power}, power=words)


def judged_after_part(replay: Replay) -> Replay:
    """Return what is played, its covariances judged by the records after those fitted to."""
    judged = first_judged(replay.log)
    return replay if judged is None else replace(replay, world=replay.world | {"judged": judged})


def first_judged(log: Log) -> int | None:
    """Return the first record after those fitted to; None if too few of these have a reference."""
    if log.referenced.size == 0:
        return None
    first = int(log.referenced[0])
    judged = first + math.ceil(PART * (len(log) - first))
    return judged if np.count_nonzero(log.referenced < judged) >= _ENOUGH else None


def _measured(world: Mapping[str, Any], assumed: Overrides, count: int) -> tuple[float, float]:
    """Return the log score of what is published, and the 95 % quantile of position errors, m."""
    trial = Trial(
        scenario=SCENARIO,
        world=Overrides(world),
        assumed=assumed,
        localizer="mcl",
        params=Overrides({"particles": _PARTICLES}),
        lag=0,
        seed=_ROOT,
        trial=0,
    )
    stage = Stage.of(trial)
    tracked = stage.collector()
    assert isinstance(tracked, TrackLog)
    for step in islice(stage.moments(), count):
        tracked.see(step)
    track = tracked.track
    off, spread = track.deviations()
    published = Calibration.fitted(off, spread).published(spread)
    score = calibration_of_gaussians(off, published, track.log.unit)[:, 2].mean()
    return float(score), float(np.quantile(track.errors.translation, 0.95))


FEW = 0.5  # share of beams within the larger distance below which log and map do not fit
_LOOKED_AT = 200  # reference poses
_STRETCHES, _LEAST = 10, 50  # of a log; poses or beams that a fit needs
_SURE = 4  # standard errors
_CELL = 0.05  # m, also of a map without cells
_REACH = 0.3  # m from a wall beyond which a beam says nothing of the mounting
_APART = 0.5  # m or rad of odometry between poses that tell of wheels
_BACKS = 5  # of such stretches backward, told as ahead, that tell of odometry without a sign
_LATEST, _PAUSE = 3.0, 5.0  # s: offsets looked for; longest pause between poses compared

_Off = Callable[[Floats], Floats]  # by the numbers that are fitted


def doubts_of(played: LogScenario) -> list[str]:
    """Return warnings about a log with a reference; clocks that differ hide all else."""
    (log, floor_plan), whole = played.recording(), played.whole
    if log.reference is None or whole.reference is None or not log.referenced.size:
        return []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LogWarning)  # told when it was read
        stamps, poses = whole.times[whole.posed], whole.reference[whole.posed]
        if (file := played.env.get("reference")) is not None:
            stamps, poses = (read := read_tum(located(file))).times, read.poses
    if late := late_words("the reference", whole.times, whole.odometry, stamps, poses, "odometry"):
        return [late]
    return doubts_by(log, floor_plan)


def doubts_by(log: Log, floor_plan: Map) -> list[str]:
    """Return warnings about the lidar's mounting and the wheels, by a log's reference poses."""
    at = log.referenced[np.unique(np.linspace(0, log.referenced.size - 1, _LOOKED_AT).astype(int))]
    return [*filter(None, [_mounting_words(log.of_records(at), floor_plan), _wheels_words(log)])]


def late_words(
    what: str, times: Floats, odometry: Floats, stamps: Floats, poses: Floats, clock: str
) -> str | None:
    """Say how late poses are, by when they turn and the odometry does; None if they hardly are."""
    headings, first, last = np.unwrap(odometry[:, 2]), stamps[:-1], stamps[1:]
    inside = (first >= times[0]) & (last <= times[-1]) & (last - first < _PAUSE)
    turns = arrays.wrapped(np.diff(poses[:, 2]))
    first, last, turns = first[inside], last[inside], turns[inside]

    def off(offset: Floats) -> Floats:
        before, after = (np.interp(at - offset, times, headings) for at in (first, last))
        return arrays.wrapped(turns - (after - before))

    starts = [np.array([offset]) for offset in sorted(np.arange(-_LATEST, _LATEST, 0.1), key=abs)]
    (late,), (sd,) = _least(turns.size, [off], starts, [0.1])
    hardly = abs(late) - _SURE * sd <= np.median(np.diff(times))
    # an offset that leaves half of the turns, or more, explains nothing
    if hardly or np.abs(off(np.array([late]))).sum() >= np.abs(turns).sum() / 2:
        return None
    word, remedy = ("late", "subtract") if late > 0 else ("early", "add")
    return (
        f"{what} seems {abs(late):.2f} s (± {sd:.2f}) {word}, by when it turns and the {clock} "
        f"does: {remedy} that in its stamps; until then errors grow with the speed."
    )


def misfit_words(share: float, where: str, scanner: Scanner) -> str | None:
    """Return the warning for a share of beams that agree with the map; None if they are enough."""
    if math.isnan(share):
        return (
            "no beam has a measurement: every range is beyond max_range or not a number; check "
            "that ranges and max_range are in m."
        )
    if share >= FEW:
        return None
    first, last = np.degrees(scanner.bearings[[0, -1]])
    return (
        f"log and map do not fit: seen {where}, only {percent(share)} of the beams are within "
        f"{AGREE[1]} m of what the map says; check that they are of the same place and floor, the "
        f"map's resolution and origin, and the angles of the beams, {first:.0f}° to {last:.0f}°."
    )


def known_part(floor_plan: Map) -> Map:
    """Return a map whose unknown cells stop no beam and are no free space either."""
    if isinstance(floor_plan, GridMap):
        return replace(floor_plan, unknown="transparent")
    return floor_plan


def _mounting_words(log: Log, floor_plan: Map) -> str | None:
    """Say how the lidar seems to be mounted, if scans fit the map better so, or that none fit."""
    scanner, size, reference = log.scanner, metre(log.unit), log.reference
    assert reference is not None
    share = agreement(log, floor_plan, reference)[1]
    misfit = misfit_words(share, "from the reference poses", scanner)
    scan, beam = np.nonzero(np.isfinite(log.ranges))
    if len(scanner.places) > 1 or not scan.size:
        return misfit
    ranges, bearings = log.ranges[scan, beam].astype(np.float64), scanner.bearings[beam]
    (x, y, heading), (ahead, left) = reference[scan].T, scanner.places[0]
    cosine, sine, known_map = np.cos(heading), np.sin(heading), known_part(floor_plan)

    def off(moved: Floats) -> Floats:
        u = ahead + moved[0] + ranges * np.cos(bearings + moved[2])
        v = left + moved[1] + ranges * np.sin(bearings + moved[2])
        ends = np.column_stack([x + cosine * u - sine * v, y + sine * u + cosine * v])
        return np.minimum(known_map.distance(ends), _REACH * size)

    turns = [0] if misfit is None else sorted(range(-180, 180, 5), key=abs)
    starts = [np.array([0.0, 0.0, math.radians(turn)]) for turn in turns]
    moved, sd = _least(scan.size, [off], starts, [_CELL * size, _CELL * size, 0.03])
    cell = floor_plan.resolution if isinstance(floor_plan, GridMap) else _CELL * size
    if not (np.abs(moved) - _SURE * sd > [cell, cell, cell / np.median(ranges)]).any():
        return misfit
    dx, dy, turn = moved.tolist()
    angles, place = tuple(scanner.bearings + turn), (ahead + dx, left + dy)
    turned = replace(scanner, angles=angles, mounting=place, turn=0.0)
    better = agreement(replace(log, scanner=turned), floor_plan, reference)[1]
    if better < max(share, FEW):
        return misfit
    return (
        f"the lidar seems turned by {math.degrees(turn):.1f}° (± {math.degrees(sd[2]):.1f}°) and "
        f"moved by {dx:.2f} and {dy:.2f} {log.unit} (± {max(sd[:2]):.2f}), ahead and left: from "
        f"the reference poses {percent(better)} of the beams are within {AGREE[1]} m of what the "
        f"map says then, now {percent(share)}; try --set world.reading.mounting="
        f"[{place[0]:.2f},{place[1]:.2f},{scanner.turn + turn:.3f}], and check that the reference "
        "is of the robot's base."
    )


def _wheels_words(log: Log) -> str | None:
    """Say how the odometry is off by the reference, in sign, distance and turns; None: hardly."""
    size = metre(log.unit)
    if log.posed.size < _LEAST:
        return None
    spaced = log.of_records(log.posed).spaced(_APART * size, _APART)
    assert spaced.reference is not None
    odometry, reference = increments_of(spaced.odometry), increments_of(spaced.reference)
    ways, along = lengths_of(odometry), (odometry * reference)[:, :2].sum(axis=1)
    back = (ways > 2 * _CELL * size) & (along < -0.25 * ways**2)
    if back.sum() >= _BACKS:
        return (
            f"the odometry has no sign: {ways[back].sum() / size:.1f} m that it goes ahead are "
            f"backward by the reference, the first at {spaced.times[back.argmax()]:.1f} s; filters "
            "can get lost there: let the driver tell backward drives as such."
        )
    near = ways < 4 * _APART * size
    (length, turn), (true_length, true_turn) = (
        (lengths_of(each[near]) / size, each[near, 2]) for each in (odometry, reference)
    )
    off: list[_Off] = [
        lambda by: true_length - (1 + by[0]) * length,
        lambda by: arrays.wrapped(true_turn - (1 + by[1]) * turn - by[2] * length),
    ]
    (ahead, more, aside), sd = _least(turn.size, off, [np.zeros(3)], [0.02, 0.02, 0.02])
    if not (np.abs([ahead, more, aside]) - _SURE * sd > _CELL / 2).any():
        return None
    return (
        f"the odometry is off: the reference goes {1 + ahead:.3f} (± {sd[0]:.3f}) times as far, "
        f"turns {1 + more:.3f} (± {sd[1]:.3f}) times as much and veers "
        f"{math.degrees(abs(aside)):.1f}° (± {math.degrees(sd[2]):.1f}°) per m to the "
        f"{'left' if aside > 0 else 'right'} of it; calibrate the radii and the "
        "separation of the wheels in the driver. The motion noise that is fitted to the log "
        "includes it."
    )


def _least(
    count: int, residuals: Sequence[_Off], starts: Sequence[Floats], steps: Sequence[float]
) -> tuple[Floats, Floats]:
    """Fit numbers to residuals, (count,) each, by steps from the best start; their errors: sd."""
    if count < _LEAST:
        return np.zeros(len(steps)), np.full(len(steps), math.inf)
    stretch, sizes = np.arange(count) * _STRETCHES // count, np.diag(steps)
    scales = [np.median(np.abs(of(starts[0]))) + 1e-3 for of in residuals]

    def cost(at: Floats) -> Floats:
        off = [np.hypot(1, of(at) / scale) for of, scale in zip(residuals, scales, strict=True)]
        return np.bincount(stretch, np.sum(off, axis=0), _STRETCHES).astype(np.float64)

    def slopes(at: Floats) -> Floats:
        return np.array([cost(at + step) - cost(at - step) for step in np.diag(steps) / 4]) * 2

    best = min(starts, key=lambda start: cost(start).sum())
    while (sizes > np.diag(steps) / 64).any():
        around = (best + sign * step for step in sizes for sign in (1, -1))
        before, best = best, min((best, *around), key=lambda at: cost(at).sum())
        sizes = sizes / 2 if best is before else sizes
    bends = [slopes(best + step) - slopes(best - step) for step in np.diag(steps) / 4]
    inverse = np.linalg.pinv(np.array(bends).sum(axis=2) * 2)
    return best, np.sqrt(np.diag(inverse @ slopes(best) @ slopes(best).T @ inverse.T)) * steps
