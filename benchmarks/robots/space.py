"""What ``deqmcl tune`` searches: ranges of parameters, built in or from a file, and how to draw."""

import math
from collections.abc import Mapping, Sequence
from itertools import compress
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace

from benchmarks.setup import documents
from benchmarks.setup.overrides import NOTHING, Overrides
from deqmcl_gym.files import UnreadableError, typed
from deqmcl_gym.numerics import Floats
from deqmcl_gym.validation import InputError, boolean, one_of, shown
from localizers import parameters

Value = float | int | str | bool
ASSUMED = ("motion", "scan")  # parts of what the filters assume; all else is the localizer's own
_DIGITS = 3  # of a value that is drawn
_STEP = 0.15  # SD of a step from a good value, as a share of the range
_FORM = "a table like {low = 0.1, high = 1.0, log = true}, a list of choices, or false"
_Finite = Annotated[float, Meta(ge=-1e100, le=1e100)]


class Range(Struct, frozen=True, kw_only=True):
    """Numbers from low to high, uniform in their value or, if ``log``, in its logarithm."""

    low: _Finite
    high: _Finite
    log: bool = False
    whole: bool = False

    def at(self, place: float) -> Value:
        """Return the value at a place from 0 (low) to 1 (high), of three digits."""
        if self.log:
            value = self.low * (self.high / self.low) ** place
        else:
            value = self.low + (self.high - self.low) * place
        value = min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)
        return round(value) if self.whole else value

    def place(self, value: Any) -> float:
        """Return the place of a value; one outside is at the nearest end."""
        value = float(min(max(float(value), self.low), self.high))
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return float((value - self.low) / (self.high - self.low))

    def near(self, value: Any, rng: np.random.Generator) -> Value:
        """Return a value a normal step away, reflected at the ends; of a word, anywhere."""
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        place = (self.place(value) if is_number else rng.random()) + _STEP * rng.standard_normal()
        return self.at(1 - abs(1 - abs(place) % 2))


class Choice(Struct, frozen=True):
    """One of two or more values."""

    values: tuple[Value, ...]

    def at(self, place: float) -> Value:
        """Return the value at a place from 0 (the first) to 1 (the last)."""
        return self.values[min(int(place * len(self.values)), len(self.values) - 1)]

    def near(self, value: Any, rng: np.random.Generator) -> Value:
        """Return another one."""
        others = [other for other in self.values if other != value]
        return others[int(rng.integers(len(others)))]


def ends_of(values: Range | Choice) -> tuple[Value, ...]:
    """Return what a localizer must take: both ends of a range, all choices."""
    return values.values if isinstance(values, Choice) else (values.at(0.0), values.at(1.0))


Space = Mapping[str, Range | Choice]

_NOISE = Range(low=0.02, high=2.0, log=True)
_MANY = Range(low=500, high=5000, log=True, whole=True)
_FEW = Range(low=50, high=500, log=True, whole=True)
_OF_AMCL: Space = {
    **{f"alpha{i}": _NOISE for i in (1, 2, 3, 4)},
    "laser_model_type": Choice(("likelihood_field", "likelihood_field_prob")),
    "sigma_hit": Range(low=0.03, high=0.5, log=True),
    "z_hit": Range(low=0.1, high=0.95),  # z_rand is 1 - z_hit: see ``Task.trial``
    "laser_likelihood_max_dist": Range(low=0.3, high=4.0, log=True),
    "max_beams": Range(low=20, high=180, log=True, whole=True),
    "max_particles": _MANY,
    "min_particles": _FEW,
    "pf_err": Range(low=0.01, high=0.2, log=True),
    "resample_interval": Choice((1, 2, 4)),
    "update_min_d": Range(low=0.05, high=0.4, log=True),
    "update_min_a": Range(low=0.05, high=0.4, log=True),
}
_OF_OTHERS: Space = {  # of each localizer those that it takes; what is for a lost robot is not here
    "particles": Range(low=200, high=5000, log=True, whole=True),
    "ess_threshold": Range(low=0.1, high=1.0),
    "beta": Range(low=0.03, high=30.0, log=True),
    "plan_beta": Range(low=0.03, high=10.0, log=True),
    "keep": Range(low=0.3, high=0.95),
    "lag": Range(low=2, high=30, log=True, whole=True),
    "gate": Range(low=0.9, high=1.0),
    "headings": Choice((36, 72, 144)),
}
_OF_SCAN: Space = {
    "scan.sigma": Range(low=0.03, high=0.5, log=True),
    "scan.power": Range(low=0.005, high=1.0, log=True),
}


def built_in(localizer: str, noise: Sequence[str], base: Mapping[str, Any] = NOTHING) -> Space:
    """Return the ranges that are searched where no file says otherwise; none of a plug-in.

    ``noise`` names the numbers of the motion model, ``base`` are the parameters before the search.
    """
    if localizer == "amcl":  # the least and the most particles fit, too, if one of them is given
        ranges = dict(_OF_AMCL)
        least, most = base.get("min_particles"), base.get("max_particles")
        if isinstance(least, int):  # what is no number is refused when the localizer looks at it
            ranges["max_particles"] = replace(_MANY, low=max(_MANY.low, least))
        if isinstance(most, int):
            ranges["min_particles"] = replace(_FEW, high=min(_FEW.high, most))
        return {n: r for n, r in ranges.items() if isinstance(r, Choice) or r.low < r.high}
    taken = parameters(localizer) or ()
    ranges = {name: values for name, values in _OF_OTHERS.items() if name in taken}
    if "lag" not in ranges:
        ranges.pop("plan_beta", None)  # it would only choose poses at a start that is not known
    return {**ranges, **_OF_SCAN, **{f"motion.{name}": _NOISE for name in noise}} if ranges else {}


def space_of(
    path: Path | None, localizer: str, noise: Sequence[str], base: Mapping[str, Any] = NOTHING
) -> Space:
    """Return what is searched: the built-in ranges, with those of a TOML file in their places.

    Each key is a parameter of the localizer, ``scan.…`` or ``motion.…``; its value a list of
    choices, a table {low, high, log, whole} or {log = [low, high]}, or false: it is not searched.
    ``only = true`` leaves out all that the file does not name.
    """
    ranges = built_in(localizer, noise, base)
    if path is None:
        if ranges:
            return ranges
        raise InputError(
            f"{localizer} has no ranges built in: name what is to be searched in a file, as in "
            "--space space.toml."
        )
    document = documents.read_toml(path, "space")
    with documents.errors_name(path):
        space = {} if boolean("only", document.pop("only", False)) else dict(ranges)
        flat: dict[str, Any] = {}
        for name, value in document.items():
            nested = name in ASSUMED and isinstance(value, Mapping)
            flat |= {f"{name}.{n}": v for n, v in value.items()} if nested else {name: value}
        taken = parameters(localizer)
        for name, value in flat.items():
            if name.partition(".")[0] not in ASSUMED and taken is not None:
                one_of(f"parameter of {localizer}", name, [*taken, "scan.…", "motion.…"])
            if value is False:
                space.pop(name, None)
            else:
                space[name] = _range(name, value)
        if not space:
            raise InputError("nothing is left to search: name a parameter with a range.")
        return space


def _range(name: str, value: Any) -> Range | Choice:
    if isinstance(value, list):
        valid = all(isinstance(choice, str | bool | int | float) for choice in value)
        if not valid or len({repr(choice) for choice in value}) < max(2, len(value)):
            raise InputError(
                f"{name} is {value}, but must list two or more numbers, words, true or false, "
                "each once."
            )
        return Choice(tuple(value))
    if not isinstance(value, Mapping):
        raise InputError(f"{name} is {shown(value)}, but must be {_FORM}.")
    for key in value:
        one_of(f"key of {name}", key, Range.__struct_fields__)
    match value:
        case {"log": [low, high], **others} if not {"low", "high"} & others.keys():
            value = {**others, "low": low, "high": high, "log": True}
    try:
        span = typed(value, Range)
    except UnreadableError as error:
        raise InputError(f"{name} {error}, but must be {_FORM}.") from None
    whole = not span.whole or (span.low.is_integer() and span.high.is_integer())
    ordered = span.low < span.high and (span.low > 0 or not span.log)
    if not (whole and ordered and span.at(0.0) != span.at(1.0)):
        raise InputError(
            f"{name} has low {span.low:.10g} and high {span.high:.10g}, but low must be below high "
            f"also if rounded to {_DIGITS} digits, with log = true above 0, and with whole = true "
            "both must be whole: give such a range, or a list of choices."
        )
    return span


def latin_hypercube(space: Space, count: int, rng: np.random.Generator) -> list[Overrides]:
    """Return candidates with a value of each parameter in each strip (McKay et al. 1979)."""
    strips = rng.permuted(np.tile(np.arange(count), (len(space), 1)), axis=1)
    places: Floats = (strips + rng.random(strips.shape)) / count
    return [
        Overrides({name: space[name].at(place) for name, place in zip(space, row, strict=True)})
        for row in places.T.tolist()
    ]


def neighbour(
    space: Space, values: Mapping[str, Any], usual: Mapping[str, Any], rng: np.random.Generator
) -> Overrides:
    """Return a candidate near good values: half of the parameters are moved, at least one.

    What the good values do not name stays as usual, as far as that is known, unless it is moved.
    """
    moved = rng.random(len(space)) < 0.5
    moved[rng.integers(len(space))] = True
    before = {name: values.get(name, usual.get(name)) for name in compress(space, moved)}
    return Overrides({**values, **{n: space[n].near(value, rng) for n, value in before.items()}})
