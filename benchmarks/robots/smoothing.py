"""``deqmcl smooth``: a reference from the log itself, and whether it may serve as one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.console import doing, log_warnings, warn
from benchmarks.robots import Replay, replay_of, values_among
from benchmarks.robots.calibration import FEW, doubts_by
from benchmarks.setup.overrides import NOTHING, Overrides
from benchmarks.sweeps.store import own_folder, write_files
from benchmarks.tables import percent
from benchmarks.trials.tracks import AGREE
from deqmcl_gym.files import utf8
from deqmcl_gym.logs import Log, Trajectory
from deqmcl_gym.logs.motion import increments_of, lengths_of
from deqmcl_gym.logs.trajectory import COLUMNS, UPPER
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Bools, Floats, Singles, arrays
from deqmcl_gym.validation import integer, one_of
from localizers.inference.backward import GaussianMotion, backward, forward
from localizers.models.scan import Scan

PATHS = 100  # backward, of a run
SMOOTHED = "smoothed.tum", "smoothed.csv"
_INDEPENDENT = 6  # beams that a scan counts as
_SLIP = 0.01  # m
_WIDE = 1.0  # m: a cloud wider than this gets more particles
_APART = 0.5  # m: the median distance from which on a run is of another place
_UNSURE = 0.25  # m: a pose with a larger standard deviation is doubtful
_WINDOW = 5  # scans: the median of their shares tells whether the place is right
_LISTED = 5  # stretches
_LONGER, _SLACK = 1.5, 1.0  # times the way by the odometry, m, that is doubtful
_MOST, _TOO_MANY = 0.05, 1 / 3  # share of doubtful records above which only parts serve, or none


@dataclass(frozen=True)
class Smoothed:
    """Poses of a log by smoothing on its map, how sure they are, and where they are doubtful."""

    log: Log  # the records that have a pose
    words: str  # what was played
    runs: Floats  # mean poses of the runs that count, (R, n, 3)
    elsewhere: int  # runs that ended at another place, with less evidence
    poses: Floats  # means over the paths of all runs that count, (n, 3)
    # within runs, between them, and of half a cell of the map, which all paths share, (n, 3, 3)
    covariances: Floats
    explained: Floats  # share of the returns that agree with the map, median over five records

    @cached_property
    def spread(self) -> Floats:
        """Standard deviation of each position, the root of both variances' sum, m, (n,)."""
        variance = self.covariances[:, 0, 0] + self.covariances[:, 1, 1]
        return np.sqrt(variance) / metre(self.log.unit)

    @cached_property
    def doubtful(self) -> Bools:
        """Which poses are not to be relied on, (n,)."""
        return (self.explained < FEW) | (self.spread > _UNSURE)

    def __str__(self) -> str:
        return f"{self.verdict}\n\n{self.words}"

    @cached_property
    def objection(self) -> str:
        """Why the poses should not serve as a reference, in words; "" if nothing speaks against."""
        share, size = float(self.doubtful.mean()), metre(self.log.unit)
        way = lengths_of(increments_of(self.poses)).sum() / size
        driven = self.log.driven[-1] / size
        if self.elsewhere >= len(self.runs):
            return f"{self.elsewhere} of {self.elsewhere + len(self.runs)} runs ended elsewhere"
        if not 1 / _LONGER < (way + _SLACK) / (driven + _SLACK) < _LONGER:
            return f"they go {way:.0f} m, the odometry {driven:.0f} m"
        return f"{percent(share)} of them are doubtful" if share > _TOO_MANY else ""

    @property
    def verdict(self) -> str:
        """Whether the poses may serve as a reference, in a paragraph."""
        distances = np.hypot(*(self.runs - self.poses)[..., :2].transpose(2, 0, 1)).max(axis=0)
        distances, share = distances / metre(self.log.unit), float(self.doubtful.mean())
        judged = "The smoothed poses may serve as a reference."
        if self.objection:
            judged = (
                f"The smoothed poses should not serve as a reference: {self.objection}. So "
                f"{SMOOTHED[0]} is not written."
            )
        elif share > _MOST:
            judged = f"Only parts may serve as a reference: {percent(share)} of it is doubtful."
        elif len(self.runs) < 2:
            judged = "One run tells nothing of its own errors: give more --seeds."
        elsewhere = (
            f" {self.elsewhere} more ended elsewhere, explain the scans worse, and do not count: a "
            "known --start is safer."
        )
        left_out = (
            f" Left out of {SMOOTHED[0]}, as fewer than half of the returns agree with the map, or "
            f"a position's standard deviation is above {_UNSURE} m: {self._stretches}."
        )
        agreed, away = float(self.explained.mean()), np.quantile(distances, 0.95)
        return (
            f"{judged} {len(self.runs)} runs are within {away:.3f} m of their mean at 95 % of "
            f"{distances.size:,} records, and {distances.max():.2f} m at most; a position's own "
            f"standard deviation is {np.median(self.spread):.3f} m (median), "
            f"{np.quantile(self.spread, 0.95):.3f} m (95 %). At the poses {percent(agreed)} of the "
            f"returns are within {AGREE[1]} m of what the map says."
            f"{elsewhere if self.elsewhere else ''}{left_out if share else ''} Errors that all "
            "runs share, of the map or of a place that looks alike, do not show."
        )

    @property
    def _stretches(self) -> str:
        """The longest stretches of doubtful records, in words."""
        edges = np.flatnonzero(np.diff(np.pad(self.doubtful, 1).astype(np.int8))).reshape(-1, 2)
        way, times = self.log.driven / metre(self.log.unit), self.log.times
        longest = sorted((edges - [0, 1]).tolist(), key=lambda ends: way[ends[0]] - way[ends[1]])
        words = [
            f"{way[first]:,.0f} to {way[last]:,.0f} m ({times[first]:.1f} to {times[last]:.1f} s)"
            for first, last in sorted(longest[:_LISTED])
        ]
        more = len(edges) - len(words)
        return "; ".join([*words, f"{more} shorter ones"] if more else words)

    def write(self, folder: str | Path) -> list[Path]:
        """Write smoothed.csv, all poses; without ``objection`` smoothed.tum, those to rely on."""
        reliable = ~self.doubtful
        upper = self.covariances[:, *np.triu_indices(3)]
        rows = np.column_stack([self.log.times, self.poses, upper])
        lines = [",".join((*COLUMNS, *UPPER)), *(",".join(map(repr, r)) for r in rows.tolist())]
        contents = {SMOOTHED[1]: utf8("\n".join(lines) + "\n")}
        if reliable.any() and not self.objection:
            contents[SMOOTHED[0]] = Trajectory(self.log.times[reliable], self.poses[reliable]).tum
        out = own_folder(Path(folder), *SMOOTHED)
        (out / SMOOTHED[0]).unlink(missing_ok=True)  # of a run that had poses to rely on
        return write_files(out, contents)


def smooth(
    log: str | Path | Sequence[str | Path],
    map: str | Path,  # noqa: A002 - as LogEnv has it
    *,
    start: str | Sequence[float],
    settings: Mapping[str, Any] = NOTHING,
    particles: int = 1000,
    seeds: int = 5,
    seed: int = 0,
) -> Smoothed:
    """Return poses of a log by its scans, its odometry and the map alone.

    Several runs of a particle filter, each with backward simulation. Runs whose median distance to
    the one of most evidence is above 0.5 m do not count. Start and settings are as for
    ``replay_of``; a scan counts as six independent beams unless assumed.scan.power is set.
    """
    integer("--particles", particles, low=2)
    integer("--seeds", seeds, low=1, high=1000)
    for name in values_among(settings):
        one_of("name of a setting of smooth", f"params.{name}", ["world.…", "assumed.…"])
    with doing("reading the log and the map"), log_warnings() as warnings:
        replay = replay_of(log, map, start=start, settings=settings)
    warn([*warnings, replay.sideways])
    if "scan.power" not in replay.assumed:
        power = min(1.0, _INDEPENDENT / replay.log.scanner.beams)
        replay = replace(replay, assumed=replay.assumed | Overrides({"scan.power": power}))
    done = list[tuple[Singles, float]]()
    for number, rng in enumerate(np.random.default_rng(seed).spawn(seeds), 1):
        with doing(f"run {number} of {seeds}"):
            done.append(_run(replay, particles, rng))
    paths, evidence = zip(*done, strict=True)
    means = np.stack([mean_poses(run) for run in paths])
    off = np.hypot(*(means - means[np.argmax(evidence)])[..., :2].transpose(2, 0, 1))
    counts = np.flatnonzero(np.median(off, axis=1) <= _APART * metre(replay.log.unit))
    runs, (played, floor_plan) = means[counts], replay.scenario.recording()
    poses, cell = mean_poses(runs), getattr(floor_plan, "resolution", 0.0)
    spread = sum(covariances(paths[k], means[k]) for k in counts) / counts.size
    spread = spread + covariances(runs, poses) * counts.size / max(counts.size - 1, 1)
    spread = spread + np.diag(np.square([cell / 2, cell / 2, 0.0]))
    elsewhere, explained = seeds - counts.size, _explained(played, floor_plan, poses)
    warn(doubts_by(replace(played, reference=poses, interpolated=None), floor_plan))
    return Smoothed(played, replay.overview, runs, elsewhere, poses, spread, explained)


def _run(replay: Replay, particles: int, rng: np.random.Generator) -> tuple[Singles, float]:
    """Return paths of one run, (paths, n, 3), and log p(o_{0:T})."""
    setup, log, length = replay.scenario, replay.log, metre(replay.log.unit)
    room = setup.room()
    room.reset(seed=0)
    robot, prior = setup.robot_model(room), setup.prior_in(room, rng)
    scans = [Scan.of(ranges, log.scanner.max_range) for ranges in log.ranges.astype(np.float64)]
    motion = GaussianMotion(motion=robot.motion, length=_SLIP * length)
    of_log = robot.scan_model(), scans, log.increments
    clouds, evidence = forward(prior, motion, *of_log, particles, rng, wide=_WIDE * length)
    return backward(clouds, motion, log.increments, PATHS, rng).transpose(2, 0, 1), evidence


def _explained(log: Log, floor_plan: Map, poses: Floats) -> Floats:
    """Share of the returns of each scan within 0.3 m of the map's, median of five scans, (n,)."""
    expected, seen = log.scanner.ranges(floor_plan, poses.T), np.isfinite(log.ranges)
    with np.errstate(invalid="ignore"):
        near = seen & (np.abs(expected - log.ranges) <= AGREE[1] * metre(log.unit))
    returns = seen.sum(axis=1)
    # a scan without a return, as in a large hall, contradicts nothing
    shares = np.where(returns > 0, near.sum(axis=1) / np.maximum(returns, 1), 1.0)
    padded = np.pad(shares, _WINDOW // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, _WINDOW)
    return np.asarray(np.median(windows, axis=1))


def mean_poses(paths: Floats | Singles) -> Floats:
    """Return the means of poses (k, n, 3), (n, 3); of headings that of their directions."""
    x, y, heading = paths.astype(np.float64).transpose(2, 0, 1)
    sine, cosine = arrays.sin(heading).mean(axis=0), arrays.cos(heading).mean(axis=0)
    return np.column_stack([x.mean(axis=0), y.mean(axis=0), arrays.arctan2(sine, cosine)])


def covariances(paths: Floats | Singles, mean: Floats) -> Floats:
    """Return the covariances of poses (k, n, 3) about their mean (n, 3), (n, 3, 3)."""
    off = paths - mean
    off[..., 2] = arrays.wrapped(off[..., 2])
    return np.asarray((off[..., :, None] * off[..., None, :]).mean(axis=0))
