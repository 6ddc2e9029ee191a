"""Which beams of a scan a belief uses, where the world is not its map: people, moved furniture.

Fox, Burgard & Thrun 1999, "Markov localization for mobile robots in dynamic environments": two
filters that judge each beam by the belief before the scan. They cannot find out that it is wrong:
the robot must be localized at the start. Evidence (quality, recovery) is that of the beams kept.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats, Indices, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64, log64
from deqmcl_gym.validation import InputError, one_of
from localizers.api import best_cluster
from localizers.inference.particles import (
    BeamFilter,
    LogWeights,
    States,
    Weights,
    maximum,
    normalized_with_log_sum,
)
from localizers.models import RobotModel, beam_kernels
from localizers.models.scan import LidarScan, Scan

JUDGES = 512  # particles, evenly spaced, by which beams are judged


def judges(states: States, log_weights: LogWeights) -> tuple[States, Weights]:
    """Return at most ``JUDGES`` particles, evenly spaced, and weights of sum 1; equal if all 0."""
    stride = (log_weights.size - 1) // JUDGES + 1
    some = np.ascontiguousarray(log_weights[::stride])
    if not some.max() > -np.inf:
        some = np.zeros(some.size)
    return states[:, ::stride], normalized_with_log_sum(some)[0]


@dataclass(frozen=True, kw_only=True)
class DistanceFilter:
    """Drop a beam if P(o is shorter than the map says) > 0.99 under the belief.

    P = Σ w Φ((ô - o) / σ), ô at most the largest range: people and what is new stand in front of
    the walls. Longer readings, as of removed walls, are never dropped. With less than 0.9 of the
    belief in one place nothing is, as what is short from one place is not from another. In Fox,
    Burgard, Thrun & Cremers 1998 it is the novelty filter.
    """

    scan: LidarScan  # p(o | x, m), whose beams have a σ

    def __post_init__(self) -> None:
        if not hasattr(self.scan.beam, "sigma"):
            kind = type(self.scan.beam).__name__
            raise InputError(
                f"the beam model is of type {kind}, without sigma, but the distance filter "
                "compares ranges by it: give another beam model or another filter."
            )

    def kept(self, states: States, log_weights: LogWeights, scan: Scan) -> Scan:
        """Return the scan without the beams that are too short; see ``BeamFilter``."""
        poses, weights = judges(states, log_weights)
        unit = self.scan.floor_plan.unit
        if scan.beams == 0 or best_cluster(poses.T, weights, unit=unit).share < 0.9:
            return scan
        return scan.without(self.shorter(poses, weights, scan) > 0.99, scan.usable)

    def shorter(self, poses: States, weights: Weights, scan: Scan) -> Floats:
        """P(o < ô) of each usable beam under weighted poses (3, n), (b,); 0 if all are outside."""
        sigma: float = self.scan.beam.sigma  # type: ignore[attr-defined]
        measured, expected = self.scan.compared(poses, scan)
        inside = ~np.isnan(expected[0])
        total = float(weights[inside].sum())
        if total == 0.0:
            return np.zeros(measured.size)
        chance, shares = np.empty(measured.size), weights[inside] / total
        max_range = self.scan.lidar.max_range
        beam_kernels.chance_of_shorter(
            measured, expected[:, inside], shares, sigma, max_range, chance
        )
        return chance


def place_cells(size: float, poses: States) -> Indices:
    """Return the cell, size × size × 5°, of each pose (3, n), numbered from 0, (n,)."""
    x, y = (np.floor(np.asarray(poses[i], np.float64) / size) for i in (0, 1))
    sector = np.floor((arrays.wrapped(poses[2]) + np.pi) / (2 * np.pi / 72))
    x, y = x - x.min(), y - y.min()
    cell = (x * (y.max() + 1) + y) * 72 + sector % 72  # whole, as float64
    return np.unique(cell, return_inverse=True)[1].reshape(-1)


@dataclass(frozen=True, kw_only=True)
class EntropyFilter:
    """Drop a beam if it raises the belief's entropy: what does not confirm the belief.

    H = -Σ p log p over places, before and after the one beam. Each is judged by itself. Where the
    belief is one place, no beam changes it and all are kept. Fox, Burgard & Thrun 1999 count over
    the cells of a grid.
    """

    scan: LidarScan
    places: Callable[[States], Indices]  # of states (d, n), as numbers from 0, (n,)

    def kept(self, states: States, log_weights: LogWeights, scan: Scan) -> Scan:
        """Return the scan without the beams that raise the entropy; see ``BeamFilter``."""
        if scan.beams == 0:
            return scan
        poses, weights = judges(states, log_weights)
        return scan.without(self.raises(poses, weights, scan), scan.usable)

    def raises(self, poses: States, weights: Weights, scan: Scan) -> Any:
        """Whether each usable beam raises the entropy of weighted poses (3, n), (b,)."""
        measured, expected = self.scan.compared(poses, scan)
        logs = np.empty((measured.size + 1, weights.size))
        logs[0] = 0.0  # no beam
        for beam in range(measured.size):
            rows = slice(beam, beam + 1)
            logs[1 + beam] = self.scan.weighed(measured[rows], expected[rows])
        entropy = np.empty(len(logs))
        entropies(logs, weights, self.places(poses), entropy)
        return ~(entropy[1:] <= entropy[0] + 1e-12)  # nats: by which equal sums may differ


@compiled
def entropies(log_factors: Floats, weights: Floats, places: Indices, out: Floats) -> None:
    """Fill in -Σ p log p over places (n,) for each row of factors (k, n); inf without weight."""
    for row in range(out.size):
        top = maximum(log_factors[row])
        masses = np.zeros(places.max() + 1)
        total, logs = 0.0, 0.0
        for i in range(weights.size if top > -np.inf else 0):
            mass = weights[i] * exp64(log_factors[row, i] - top)
            masses[places[i]] += mass
            total += mass
        for place in range(masses.size):
            if masses[place] > 0.0:
                logs += masses[place] * log64(masses[place])
        out[row] = log64(total) - logs / total if total > 0.0 else np.inf


def beam_filter(name: str, robot: RobotModel) -> BeamFilter | None:
    """Return the filter of a name for a robot's scan model; None for "none"."""
    if one_of("beam_filter", name, ("none", "distance", "entropy")) == "none":
        return None
    scan = robot.beam_scan(f"beam_filter = {name!r}")
    if name == "distance":
        return DistanceFilter(scan=scan)
    return EntropyFilter(scan=scan, places=partial(place_cells, 5 * pixel(scan.floor_plan.unit)))
