"""``deqmcl smooth``: a reference from the log itself, and whether it may serve as one."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.console import doing, log_warnings, warn
from benchmarks.files import own_folder, write_files
from benchmarks.robots.played import Replay, replay_of
from benchmarks.robots.replaying import FEW
from benchmarks.setup.overrides import NOTHING, Overrides
from benchmarks.tables.text import percent
from benchmarks.trials.tracks import AGREE
from deqmcl_gym.files import utf8
from deqmcl_gym.logs import Log, Trajectory
from deqmcl_gym.logs.estimates import COLUMNS, UPPER
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Bools, Floats, Singles, arrays
from deqmcl_gym.validation import InputError, integer
from localizers.inference.backward import Clouds, backward, forward
from localizers.models.gaussian_motion import GaussianMotion
from localizers.models.scan import Scan

PATHS = 100  # backward, of a run
FILES = "smoothed.tum", "smoothed.csv"
_INDEPENDENT = 6  # beams that a scan counts as
_SLIP = 0.01  # m
_WIDE = 1.0  # m: a cloud wider than this gets more particles
_APART = 0.5  # m: the median distance from which on a run is of another place
_UNSURE = 0.25  # m: a pose with a larger standard deviation is doubtful
_WINDOW = 5  # scans: the median of their shares tells whether the place is right
_TOLD = 5  # stretches
_MOST = 0.05  # share of doubtful records up to which the rest may serve


@dataclass(frozen=True)
class Smoothed:
    """Poses of a log by smoothing on its map, how sure they are, and where they are doubtful."""

    log: Log  # the records that have a pose
    floor_plan: Map
    runs: Floats  # mean poses of the runs that count, (R, n, 3)
    within: Floats  # mean of their covariances, (n, 3, 3)
    elsewhere: int  # runs that ended at another place, with less evidence

    @cached_property
    def poses(self) -> Floats:
        """Mean pose of each record, over the paths of all runs that count, (n, 3)."""
        return mean_poses(self.runs)

    @cached_property
    def covariances(self) -> Floats:
        """Covariance of each pose, that within runs and that between them, (n, 3, 3)."""
        runs = len(self.runs)
        return self.within + (covariances(self.runs, self.poses) * runs / max(runs - 1, 1))

    @cached_property
    def explained(self) -> Floats:
        """Share of a scan's beams within 0.3 m of the map, median over five records, (n,)."""
        expected = self.log.scanner.ranges(self.floor_plan, self.poses.T)
        seen = np.isfinite(self.log.ranges)
        with np.errstate(invalid="ignore"):
            near = np.abs(expected - self.log.ranges) <= AGREE[1] * metre(self.log.unit)
        shares = (near & seen).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
        padded = np.pad(shares, _WINDOW // 2, mode="edge")
        return np.median(np.lib.stride_tricks.sliding_window_view(padded, _WINDOW), axis=1)

    @cached_property
    def spread(self) -> Floats:
        """Standard deviation of each position, the root of both variances' sum, m, (n,)."""
        variance = self.covariances[:, 0, 0] + self.covariances[:, 1, 1]
        return np.sqrt(variance) / metre(self.log.unit)

    @cached_property
    def doubtful(self) -> Bools:
        """Which poses are not to be relied on, (n,)."""
        return (self.explained < FEW) | (self.spread > _UNSURE)

    @property
    def verdict(self) -> str:
        """Whether the poses may serve as a reference, in a paragraph."""
        apart = np.hypot(*(self.runs - self.poses)[..., :2].transpose(2, 0, 1))
        apart = apart.max(axis=0) / metre(self.log.unit)
        share, count = self.doubtful.mean(), len(self.runs)
        if count < 2:
            judged = "One run tells nothing of its own errors: give more --seeds."
        elif share <= _MOST:
            judged = "It may serve as a reference."
        else:
            judged = f"It should not serve as a reference: {percent(share)} of it is doubtful."
        texts = [
            f"{judged} {count} runs are within {np.quantile(apart, 0.95):.3f} m of their mean at "
            f"95 % of {apart.size:,} records, and {apart.max():.2f} m at most; a position's own "
            f"standard deviation is {np.median(self.spread):.3f} m (median), "
            f"{np.quantile(self.spread, 0.95):.3f} m (95 %). Seen from the poses, "
            f"{percent(np.mean(self.explained))} of a scan's beams are within {AGREE[1]} m of the "
            "map."
        ]
        if self.elsewhere:
            texts.append(
                f"{self.elsewhere} more runs ended elsewhere, explain the scans worse, and do not "
                "count: a known --start is safer."
            )
        if where := self._stretches:
            texts.append(
                f"Left out of {FILES[0]}, as fewer than half of the beams agree or a position is "
                f"known to more than {_UNSURE} m only: {'; '.join(where)}."
            )
        texts.append(
            "Errors that all runs share, of the map or of a place that looks alike, do not show."
        )
        return " ".join(texts)

    @property
    def _stretches(self) -> list[str]:
        """The longest stretches of doubtful records, in words."""
        edges = np.flatnonzero(np.diff(np.pad(self.doubtful, 1).astype(np.int8))).reshape(-1, 2)
        way, times = self.log.driven / metre(self.log.unit), self.log.times
        ends = edges - [0, 1]
        longest = sorted(ends.tolist(), key=lambda pair: way[pair[0]] - way[pair[1]])[:_TOLD]
        words = [
            f"{way[first]:,.0f} to {way[last]:,.0f} m ({times[first]:.1f} to {times[last]:.1f} s)"
            for first, last in sorted(longest)
        ]
        more = len(edges) - len(words)
        return [*words, f"{more} shorter stretches"] if more else words

    def write(self, folder: str | Path) -> list[Path]:
        """Write smoothed.tum, the poses to rely on, and smoothed.csv, all with covariances."""
        kept = ~self.doubtful
        rows = np.column_stack(
            [self.log.times, self.poses, self.covariances[:, *np.triu_indices(3)]]
        )
        lines = [",".join((*COLUMNS, *UPPER)), *(",".join(map(repr, r)) for r in rows.tolist())]
        return write_files(
            own_folder(Path(folder), *FILES),
            {
                FILES[0]: Trajectory(self.log.times[kept], self.poses[kept]).tum,
                FILES[1]: utf8("\n".join(lines) + "\n"),
            },
        )


def smooth(
    log: str | Path | Sequence[str | Path],
    map: str | Path,  # noqa: A002 - as LogEnv has it
    *,
    start: str | Sequence[float] | None = None,
    settings: Mapping[str, Any] = NOTHING,
    particles: int = 2000,
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
    with doing("reading the log and the map"), log_warnings() as warnings:
        replay = replay_of(log, map, start=start, settings=settings)
    warn([*warnings, replay.sideways])
    if "scan.power" not in replay.assumed:
        power = min(1.0, _INDEPENDENT / replay.log.scanner.beams)
        replay = replace(replay, assumed=replay.assumed | Overrides({"scan.power": power}))
    runs, spreads, evidence = [], [], []
    for number, rng in enumerate(np.random.default_rng(seed).spawn(seeds), 1):
        with doing(f"run {number} of {seeds}"):
            paths, log_evidence = _run(replay, particles, rng)
        mean = mean_poses(paths)
        runs.append(mean)
        spreads.append(covariances(paths, mean))
        evidence.append(log_evidence)
    poses = np.stack(runs)
    off = np.hypot(*(poses - poses[np.argmax(evidence)])[..., :2].transpose(2, 0, 1))
    counts = np.median(off, axis=1) <= _APART * metre(replay.log.unit)
    played, floor_plan = replay.scenario.recording()
    within = np.stack(spreads)[counts].mean(axis=0)
    return Smoothed(played, floor_plan, poses[counts], within, int((~counts).sum()))


def _run(replay: Replay, particles: int, rng: np.random.Generator) -> tuple[Singles, float]:
    """Return paths of one run, (paths, n, 3), and log p(o_{0:T})."""
    setup, log = replay.scenario, replay.log
    room = setup.room()
    robot = setup.robot_model(room)
    ranges = log.ranges.astype(np.float64)
    scans = [Scan.of(scan, log.scanner.max_range) for scan in ranges]
    motion = GaussianMotion(motion=robot.motion, length=_SLIP * metre(log.unit))
    clouds: Clouds = forward(
        setup.prior_in(room, rng), motion, robot.scan_model(), scans, log.increments, particles,
        rng, wide=_WIDE * metre(log.unit),
    )  # fmt: skip
    paths = backward(clouds, motion, log.increments, PATHS, rng)
    return paths.transpose(2, 0, 1), clouds.log_evidence


def mean_poses(paths: Floats | Singles) -> Floats:
    """Return the means of poses (k, n, 3), (n, 3); of headings that of their directions."""
    x, y, heading = paths.astype(np.float64).transpose(2, 0, 1)
    sine, cosine = arrays.sin(heading).mean(axis=0), arrays.cos(heading).mean(axis=0)
    return np.column_stack([x.mean(axis=0), y.mean(axis=0), arrays.arctan2(sine, cosine)])


def covariances(paths: Floats | Singles, mean: Floats) -> Floats:
    """Return the mean products of what poses (k, n, 3) are off their mean (n, 3), (n, 3, 3)."""
    off = paths - mean
    off[..., 2] = arrays.wrapped(off[..., 2])
    return np.asarray((off[..., :, None] * off[..., None, :]).mean(axis=0))
