"""The beam model that fits readings from known poses best: expectation maximization.

Thrun, Burgard & Fox 2005, section 6.3.2, table 6.2, but a reading at the largest range is of max
alone, and σ and λ are those of densities cut to [0, max_range] and [0, ô]: they are raised by a
search along a line, as closed forms are no maximum there, so that readings get no less likely.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from deqmcl_gym.numerics import Floats, Reals, arrays
from deqmcl_gym.numerics.arrays import normal_cdf
from deqmcl_gym.validation import InputError
from localizers.models.beams import BeamModel

LEAST_READINGS = 100  # readings
_ROUNDS = 500  # at most
_ENOUGH = 1e-9  # nats per reading: gained in the last round
_NARROWEST, _WIDEST = 1e-4, 1e4  # σ and 1 / λ, in largest ranges …
_FLATTEST = 100.0  # … and the largest 1 / λ: there the part short is flat to 1 %
_NEAREST = 1e-8  # ranges: the least ô of the part short, to avoid a division by 0
_FIRST_STEP = 0.5  # of the searches, in log σ and log λ


@dataclass(frozen=True)
class BeamFit:
    """A beam model fitted to so many readings, the mean of whose log-likelihoods rose by rounds."""

    model: BeamModel
    readings: int
    log_likelihoods: tuple[float, ...]


def fitted(ranges: Floats, expected: Reals, max_range: float) -> BeamFit:
    """Return the beam model of greatest likelihood for readings o of exact ranges ô, (k,) each.

    Each share is at least that of one reading, as what did not occur in a log may occur yet.
    Ranges outside [0, max_range] and NaN are left out; fewer than 100 below it are refused.
    """
    usable = (ranges >= 0) & (ranges <= max_range) & ~np.isnan(expected)
    count, at_max = int(usable.sum()), usable & (ranges >= max_range)
    own = usable & ~at_max
    if own.sum() < LEAST_READINGS:
        raise InputError(
            f"{int(own.sum()):,} readings are below the largest range of {max_range:g}, too few to "
            f"fit a beam model, which needs {LEAST_READINGS}."
        )
    inside = _Readings(ranges[own], np.minimum(expected[own], max_range), max_range)
    model = inside.begun(float(at_max.sum()) / count)
    owners, value = inside.owned(model)
    found = [value]
    steps = [_FIRST_STEP, _FIRST_STEP]
    for _ in range(_ROUNDS):
        model = inside.raised(model, owners, steps)
        owners, value = inside.owned(model)
        found.append(value)
        if found[-1] - found[-2] < _ENOUGH:
            break
    least = 1 / count
    shares = np.maximum([model.hit, model.short, model.max, model.rand], least)
    hit, short, most, rand = (shares / shares.sum()).tolist()
    model = replace(model, hit=hit, short=short, max=most, rand=rand)
    return BeamFit(model, count, tuple(found))


@dataclass(frozen=True)
class _Readings:
    """Ranges o below the largest one, and the exact ones ô, at most it, (k,) each."""

    ranges: Floats
    expected: Floats
    max_range: float

    def begun(self, largest: float) -> BeamModel:
        """Return a model to start from, ``largest`` its share max: σ by the median of |o - ô|."""
        sigma = 1.5 * float(np.median(np.abs(self.ranges - self.expected)))
        rest = 1 - largest
        return BeamModel(
            hit=0.7 * rest, short=0.15 * rest, max=largest, rand=1 - largest - 0.85 * rest,
            sigma=max(sigma, _NARROWEST * self.max_range), decay=2 / self.max_range,
        )  # fmt: skip

    def owned(self, model: BeamModel) -> tuple[Floats, float]:
        """Return P(hit, short or rand) of each reading, (3, k); and the mean log-likelihood."""
        shares = arrays.log([model.hit, model.short, model.rand, model.max])
        logs = np.stack([
            shares[0] + self.log_hits(model.sigma),
            shares[1] + self.log_shorts(model.decay),
            np.full(self.ranges.size, shares[2] - arrays.log([self.max_range])[0]),
        ])  # fmt: skip
        top = logs.max(axis=0)
        owners = arrays.exp(logs - top)
        sums = owners.sum(axis=0)
        inside = 1 - model.max
        value = inside * float((top + arrays.log(sums)).mean())
        if model.max > 0:
            value += model.max * float(shares[3])
        return owners / sums, value

    def log_hits(self, sigma: float) -> Floats:
        """Log N(o; ô, σ²) cut to [0, max_range], (k,)."""
        z = (self.ranges - self.expected) / sigma
        above = normal_cdf((self.max_range - self.expected) / sigma)
        inside = above - normal_cdf(-self.expected / sigma)
        logs: Floats = -0.5 * np.square(z) - arrays.log(sigma * math.sqrt(2 * math.pi) * inside)
        return logs

    def log_shorts(self, decay: float) -> Floats:
        """Log λ exp(-λ o) cut to [0, ô], (k,)."""
        nearest = np.maximum(self.expected, self.max_range * _NEAREST)
        cut = arrays.log(1 - arrays.exp(-decay * nearest))
        inside = arrays.log([decay])[0] - decay * self.ranges - cut
        return np.where(self.ranges <= self.expected, inside, -np.inf)

    def raised(self, model: BeamModel, owners: Floats, steps: list[float]) -> BeamModel:
        """Return a model of no lower likelihood; steps of the searches for σ and λ are changed."""
        sums = owners.sum(axis=1)
        hit, short, _ = ((1 - model.max) * sums / sums.sum()).tolist()
        rand = max(1 - model.max - hit - short, 0.0)
        widths = _NARROWEST * self.max_range, _WIDEST * self.max_range
        decays = 1 / (_FLATTEST * self.max_range), 1 / widths[0]
        sigma, steps[0] = _higher(
            lambda width: _weighed(owners[0], self.log_hits(width)), model.sigma, steps[0], widths
        )
        decay, steps[1] = _higher(
            lambda rate: _weighed(owners[1], self.log_shorts(rate)), model.decay, steps[1], decays
        )
        return replace(model, hit=hit, short=short, rand=rand, sigma=sigma, decay=decay)


def _higher(
    value_of: Callable[[float], float], at: float, step: float, bounds: tuple[float, float]
) -> tuple[float, float]:
    """Return the best of ``at``, a step to either side, their parabola's top; and the next step."""
    tried = [_times(at, move, bounds) for move in (-step, 0.0, step)]
    low, here, high = values = [value_of(x) for x in tried]
    bend = low - 2 * here + high
    top = 0.5 * step * (low - high) / bend if bend < 0 else 0.0
    move = float(np.clip(top, -2 * step, 2 * step))
    tried.append(_times(at, move, bounds))
    values.append(value_of(tried[-1]))
    return tried[int(np.argmax(values))], float(np.clip(2 * abs(move), 1e-4, _FIRST_STEP))


def _times(at: float, move: float, bounds: tuple[float, float]) -> float:
    """Return at · exp(move), within bounds."""
    size = float(arrays.exp([-abs(move)])[0])
    return min(max(at * size if move <= 0 else at / size, bounds[0]), bounds[1])


def _weighed(weights: Floats, logs: Floats) -> float:
    """Σ w log p over readings of some weight."""
    some = weights > 0
    return float((weights[some] * logs[some]).sum())
