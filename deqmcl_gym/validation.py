"""Checks of input. A refusal is one sentence: what was given, what is allowed, what to do."""

import dataclasses
import difflib
import inspect
import math
import numbers
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.numerics import Floats, T

LARGEST = 1e12  # magnitude of a number: products of two are finite in float32
SUM_TOLERANCE = 1e-3  # of weights: a million of float32 add up to 1 within this
SMALLEST = 1e-30  # of a number that must be above 0: its inverse is finite in float32
_LARGEST = 2**128  # seeds of NumPy have as many bits
_SHOWN = 200  # characters of a value in a sentence
_MOST = 2_000  # characters of a sentence


class LogWarning(UserWarning):
    """A problem in a log, and how it was handled."""


def tell(sentence: str) -> None:
    """Give a ``LogWarning``, at the line outside this package that reads the log."""
    level, frame = 2, inspect.currentframe()
    while frame is not None and frame.f_globals["__name__"].startswith("deqmcl_gym."):
        level, frame = level + 1, frame.f_back
    warnings.warn(sentence, LogWarning, stacklevel=level - 1)


def like(argument: str, value: object) -> str:
    """Tell how an argument of ``logs.read`` is given at the command line."""
    return f", as --set world.reading.{argument}={value}"


class InputError(ValueError):
    """Bad input. Its message is one sentence, shown as it is at the command line."""

    def __init__(self, sentence: str) -> None:
        """Put ``sentence`` on one line, even if it contains an array."""
        super().__init__(one_line(sentence))


class UnknownArgumentError(InputError, TypeError):
    """A keyword argument that is not taken, as clients try them: a ``TypeError``, as Python's."""

    def __init__(self, sentence: str) -> None:  # of which gym.make writes more
        super().__init__(sentence.partition(" was raised from the environment creator")[0])


class UnavailableError(InputError, AttributeError):
    """A property that an object does not have as it was made: ``hasattr`` says so, too."""


class NoEpisodeError(RuntimeError, AttributeError):
    """A property of an episode, but none is under way: ``hasattr`` and debuggers pass it over."""

    def __init__(self, sentence: str = "the episode has not begun: call reset() first.") -> None:
        super().__init__(sentence)


def one_line(text: str) -> str:
    """Return a text on one line, control characters escaped; a long one shortened in the middle."""
    line = " ".join(text.split())
    if not line.isprintable():
        line = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)
    return line if len(line) <= _MOST else _shortened(line, _MOST)


def _shortened(text: str, most: int) -> str:
    half = most // 2 - 2
    return f"{text[:half]} … {text[-half:]}"


def shown(value: object) -> str:
    """Return ``repr(value)``, shortened in the middle."""
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python writes
        return "a number of thousands of digits"
    return text if len(text) <= _SHOWN else _shortened(text, _SHOWN)


def in_words(error: BaseException) -> str:
    """Return an error on one line: "KeyError: 'offset'", or its type if it has no message."""
    try:
        words = one_line(str(error))
    except BaseException as another:
        words = f"its message cannot be shown ({type(another).__name__})"
    return ": ".join(filter(None, [type(error).__name__, words]))


def digits(value: float) -> str:
    """Return a number in the fewest digits that are exact: 10, 0.1, 10.0000001."""
    short = f"{value:g}"
    return short if math.isnan(value) or float(short) == value else repr(float(value))


def one_of(what: str, name: object, valid: Iterable[str], further: str = "") -> str:
    """Return ``name`` if it is among ``valid``, else refuse it with the nearest valid one.

    The refusal ends with what is allowed ``further``.
    """
    names = sorted({*valid})
    if isinstance(name, str) and name in names:
        return name
    nearest = difflib.get_close_matches(str(name), names, n=1, cutoff=0.4)
    hint = f"did you mean {nearest[0]!r}? " if nearest else ""
    allowed = ", ".join(names) or "none"
    raise InputError(f"unknown {what} {shown(name)}: {hint}allowed values: {allowed}{further}.")


def amount(number: int, noun: str) -> str:
    """Return "1 run", "2,000 runs"."""
    return f"{number:,} {noun}{'s' * (number != 1)}"


def check_arguments(given: Iterable[str], valid: Iterable[str]) -> None:
    """Refuse keyword arguments that are not among ``valid``, with the nearest one that is."""
    names = list(valid)
    for name in given:
        try:
            one_of("keyword argument", name, names)
        except InputError as error:
            words = str(error).replace("unknown", "unexpected", 1)
            raise UnknownArgumentError(words) from None


def number(
    what: str,
    value: object,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    above: bool = False,
    finite: bool = True,
) -> float:
    """Return a real number in [low, high] (in (low, high] if ``above``), else refuse it.

    Magnitudes above ``LARGEST`` are refused too, unless ``finite`` is False.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        allowed = _interval(low, high, above, finite)
        raise InputError(f"{what} is {shown(value)}, but must be a number {allowed}.")
    try:
        given = float(value)
    except OverflowError:  # of an integer
        given, finite = math.inf if value > 0 else -math.inf, True  # type: ignore[operator]
    if finite and abs(given) > LARGEST:
        allowed = _interval(max(low, -LARGEST), min(high, LARGEST), above, finite)
        raise InputError(f"{what} is {shown(value)}, but must be a number {allowed}.")
    if above and 0.0 <= low < given < SMALLEST:
        low, above = SMALLEST, False
    inside = low < given if above else low <= given
    if not (inside and given <= high):
        allowed = _interval(low, high, above, finite)
        raise InputError(f"{what} is {digits(given)}, but must be a number {allowed}.")
    return given


def keep_plain(part: object) -> None:
    """Convert the numbers in a frozen dataclass to int and float.

    With a ``numpy.float32`` among them, NumPy would compute in single precision from there on.
    """
    for field in dataclasses.fields(part):  # type: ignore[arg-type]
        value = getattr(part, field.name)
        if isinstance(value, numbers.Real) and not isinstance(value, int | float):
            plain = int(value) if isinstance(value, numbers.Integral) else float(value)
            object.__setattr__(part, field.name, plain)


def boolean(what: str, value: object) -> bool:
    """Return a truth value, else refuse it (1 and "yes" are refused)."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{what} is {shown(value)}, but must be True or False.")
    return bool(value)


def integer(what: str, value: object, *, low: int = 0, high: int | None = None) -> int:
    """Return a whole number in [low, high], else refuse it (1.5 and True are refused)."""
    allowed = f"of {low} or more" if high is None else f"from {low} to {high:,}"
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise InputError(f"{what} is {shown(value)}, but must be a whole number {allowed}.")
    given = int(value)
    if high is None and given > _LARGEST:
        allowed, high = f"from {low} to 2^128", _LARGEST
    if given < low or (high is not None and given > high):
        raise InputError(f"{what} is {shown(given)}, but must be a whole number {allowed}.")
    return given


def real(what: str, value: ArrayLike | None, wanted: str = "rows of numbers") -> NDArray[Any]:
    """Return real numbers of any type and shape, NaN among them, as an array, else refuse them."""
    try:
        given = np.asarray(value)
    except ValueError:  # ragged
        given = np.empty(0, object)
    truths = isinstance(value, list | tuple) and any(isinstance(v, bool | np.bool_) for v in value)
    # "1.5" and True are not numbers; nobody knows those that are masked
    if given.dtype.kind not in "fiu" or truths or isinstance(value, np.ma.MaskedArray):
        raise InputError(f"{what} is {shown(value)}, but must be {wanted}.")
    return given


def array(what: str, value: ArrayLike | None, shape: tuple[int | None, ...]) -> Floats:
    """Return numbers of ``shape`` (None: any length) as a fresh float64 array, else refuse them.

    NaN and magnitudes above ``LARGEST`` are refused.
    """
    given = real(what, value, _numbers(shape))
    with np.errstate(over="ignore"):  # of a wider float
        given = given.astype(np.float64)
    fits = (asked in (None, n) for asked, n in zip(shape, given.shape, strict=True))
    if given.ndim != len(shape) or not all(fits):
        seen = " x ".join(map(str, given.shape)) or "a single number"
        raise InputError(f"{what} has shape {seen}, but must be {_numbers(shape)}.")
    if not np.abs(given).max(initial=0.0) <= LARGEST:  # False for NaN, too
        allowed = f"{_numbers(shape)} of at most {LARGEST:g}"
        if given.size <= 12:
            raise InputError(f"{what} is {given.tolist()}, but must be {allowed}.")
        where = np.argwhere(~(np.abs(given) <= LARGEST))[0].tolist()
        named = digits(given[tuple(where)])
        raise InputError(f"{what} has {named} at {where}, but must be {allowed}.")
    return given


def pose(what: str, value: ArrayLike) -> tuple[float, float, float]:
    """Return a pose (x, y, heading), else refuse it; a heading above 2π may be in degrees."""
    x, y, heading = array(what, value, (3,)).tolist()
    if abs(heading) > 2 * math.pi:
        raise InputError(
            f"{what} is ({', '.join(map(digits, (x, y, heading)))}), but its heading must be in "
            f"radians, from -2π to 2π: {heading:g}° would be {math.radians(heading):.4g}."
        )
    return x, y, heading


def part(what: str, cls: type[T], value: T | Mapping[str, Any] | None, default: T) -> T:
    """Return a frozen dataclass, from an instance, a mapping of changes to ``default``, or None.

    So every part of the world can be configured by JSON-able keyword arguments.
    """
    if value is None:
        return default
    if isinstance(value, cls):
        return value
    names = [field.name for field in dataclasses.fields(cls)]  # type: ignore[arg-type]
    if not isinstance(value, Mapping):
        raise InputError(
            f"{what} is {shown(value)}, but must be a {cls.__name__} or a mapping of "
            f"{', '.join(names)}."
        )
    for key in value:
        one_of(f"key in {what}", key, names)
    return dataclasses.replace(default, **value)  # type: ignore[type-var]


def _numbers(shape: tuple[int | None, ...]) -> str:
    return " x ".join("n" if size is None else str(size) for size in shape) + " finite numbers"


def _interval(low: float, high: float, above: bool, finite: bool) -> str:
    left = "above" if above else "from"
    if math.isinf(low) and math.isinf(high):
        return "that is finite" if finite else "that is not NaN"
    if math.isinf(high):
        return f"above {digits(low)}" if above else f"of {digits(low)} or more"
    return f"{left} {digits(low)} to {digits(high)}"
