"""A learned scan model: p(z | x, m) of a whole scan, for worlds that are not as on their map.

It is a proper conditional density, the product over the usable beams in their order

    p(z | x, m) = Π_b p(z_b | z_1 … z_{b-1}, ẑ(x, m)),

ẑ the ranges that the map gives. Each factor is a mixture of three normal densities, of a beam that
meets the wall of the map, something nearer, or something farther, and of a uniform one; as the
sensor does, each is cut to [0, max_range], what is beyond being the mass of the ends. A small net
gives shares, means and widths from ẑ_b, its neighbours, and how the beams before b fitted: a beam
beside one that met a box is likely to meet it, too.

``train_scan_model.py`` makes ``learned_scan.npz``. To run it needs NumPy alone.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.numerics.arrays import normal_cdf
from deqmcl_gym.validation import InputError
from localizers import LatentShare, Localizer, RobotModel, make
from localizers.models.scan import OUTSIDE, Scan
from localizers.registry import ScanPlugIn

WEIGHTS = Path(__file__).with_name("learned_scan.npz")
READ, HIDDEN, SAID = 12, 24, 9  # numbers that describe a beam; of units; that the net answers
MISS = 1.5  # m: a beam farther off than this, three σ of the sensor, did not meet the wall
WIDTHS = -3.0, 2.5  # least and largest log of a σ in m
FLOOR = 0.01  # least share of the uniform part
_STEPS = 400  # the uniform part has the mass of one step of the range at either end
_ROOT = np.sqrt(2 * np.pi)


class ScanNet:
    """The weights that ``train_scan_model.py`` writes, and the density of scans that they are.

    Attributes:
        beams: of the lidar that it was trained for.
        reach: the largest range of that lidar, m.
    """

    def __init__(self, file: Path = WEIGHTS) -> None:
        with np.load(file) as weights:
            net = {name: weights[name] for name in weights.files}
        self.beams, self.reach = int(net.pop("beams")), float(net.pop("max_range"))
        self._layers = [
            (net[f"{layer}.weight"].T.astype(np.float32), net[f"{layer}.bias"].astype(np.float32))
            for layer in ("0", "2", "4")
        ]

    def log_density(self, measured: np.ndarray, expected: np.ndarray) -> np.ndarray:
        """Log p(z_b | z_1 … z_{b-1}, ẑ) of scans in the order of their beams, both (n, B), (n, B).

        The density of a range inside, the mass of one at an end.
        """
        reach = self.reach
        measured, expected = (np.asarray(one, np.float32) for one in (measured, expected))
        said = features(measured, expected, reach).reshape(-1, READ)
        for number, (weight, bias) in enumerate(self._layers):
            said = said @ weight + bias
            if number < len(self._layers) - 1:
                np.maximum(said, 0, out=said)
        said = said.reshape(*measured.shape, SAID)
        shares, means, sigmas = mixture(said, expected, reach)
        far = (measured[..., None] - means) / sigmas
        step = reach / _STEPS
        density = np.exp(-0.5 * far**2) / (sigmas * _ROOT)
        anything = np.full(measured.shape, 1 / (reach + 2 * step), np.float32)
        for at, sign in ((measured >= reach, -1), (measured <= 0, 1)):
            density[at] = normal_cdf(sign * far[at])  # of what is beyond this end
            anything[at] *= step
        hits: np.ndarray = (shares[..., :3] * density).sum(axis=-1)
        return np.log(hits + shares[..., 3] * anything)


class LearnedScan:
    """The density as a scan model, for a lidar as it was trained for, on a map in metres.

    Args:
        floor_plan, lidar: as for every scan model.
    """

    def __init__(self, floor_plan: Map, lidar: Lidar) -> None:
        self.floor_plan, self.lidar, self.net = floor_plan, lidar, ScanNet()
        if floor_plan.unit != "m":
            raise InputError("the learned scan model is for maps in metres, but this is in px.")
        if (lidar.beams, lidar.max_range) != (self.net.beams, self.net.reach):
            raise InputError(
                f"the learned scan model was trained for {self.net.beams} beams of "
                f"{self.net.reach:g} m, but the lidar has {lidar.beams} of {lidar.max_range:g} m: "
                "use another model, or train it for this lidar."
            )

    def log_likelihood(self, states: np.ndarray, scan: Scan) -> np.ndarray:
        """Log p(z | x, m) at each pose (3, n), (n,); -30 a beam where a ray starts off the map."""
        expected = self.lidar.ranges(self.floor_plan, states, scan.usable)
        off = np.isnan(expected).any(axis=1)
        expected[off] = 0.0
        measured = np.broadcast_to(scan.ranges[scan.usable], expected.shape)
        found = self.net.log_density(measured, expected).sum(axis=1)
        return np.where(off, OUTSIDE * expected.shape[1], found)


def features(measured: np.ndarray, expected: np.ndarray, reach: float) -> np.ndarray:
    """What the net reads of each beam: ẑ around it, and how the beams before it fitted.

    Args:
        measured, expected: ranges of the usable beams in their order, m, (n, B).
        reach: the largest range, m.

    Returns:
        (n, B, ``READ``) float32. The measured range of a beam is not among its own numbers.
    """
    seen = np.minimum(expected, reach)
    off = measured - seen
    beams = np.arange(seen.shape[1])
    fit = np.clip(off / MISS, -3, 3)
    before = np.maximum(beams, 1)

    def earlier(values: np.ndarray) -> np.ndarray:  # their mean over the beams before each
        total: np.ndarray = np.cumsum(values, axis=1) - values
        return total / before

    def ago(count: int) -> np.ndarray:
        shifted = np.zeros_like(fit)
        shifted[:, count:] = fit[:, : max(0, seen.shape[1] - count)]
        return shifted

    around = [(np.roll(seen, k, axis=1) - seen) / reach for k in (2, 1, -1, -2)]
    read = [
        seen / reach, expected > reach, *around, ago(1), ago(2), earlier(off < -MISS),
        earlier(off > MISS), earlier(np.abs(fit)), np.broadcast_to(beams / 16, seen.shape),
    ]  # fmt: skip
    return np.stack([np.asarray(one, np.float32) for one in read], axis=-1)


def mixture(
    said: np.ndarray, expected: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shares (…, 4), means (…, 3) and widths (…, 3) of the parts, from the net's answers.

    The parts are the wall of the map, something nearer, something farther, and anything.
    """
    shares = np.exp(said[..., :4] - said[..., :4].max(axis=-1, keepdims=True))
    shares *= (1 - FLOOR) / shares.sum(axis=-1, keepdims=True)
    shares[..., 3] += FLOOR
    wall, most = np.minimum(expected, 2 * reach), 2 * reach
    nearer, farther = 1 / (1 + np.exp(-said[..., 4])), 1 / (1 + np.exp(-said[..., 5]))
    means = np.stack([wall, wall * nearer, wall + (most - wall) * farther], axis=-1)
    return shares, means, np.exp(np.clip(said[..., 6:], *WIDTHS))


def mcl_map(robot: RobotModel, *, particles: int = 1000) -> Localizer:
    """``mcl-map`` with the learned model, so that a sweep pairs it with others."""
    scan = ScanPlugIn(kind=f"{Path(__file__).resolve()}:LearnedScan")
    return make("mcl-map", replace(robot, scan=scan), particles=particles)


def latent_share(robot: RobotModel, *, particles: int = 1000) -> Localizer:
    """``mcl-map`` with the share of unexplained beams summed out: no learning."""
    return make(
        "mcl-map", replace(robot, scan=LatentShare(sigma=robot.scan.sigma)), particles=particles
    )
