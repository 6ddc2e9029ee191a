"""The checks behind every refusal: what they let through, and that they answer in one sentence."""

import dataclasses
import fractions
import math
import numbers
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refused

from deqmcl_gym import Driver, GridMap, Lap, Lidar, MotionNoise, Office, Robot, Route, Start
from deqmcl_gym.validation import (
    LARGEST,
    InputError,
    array,
    digits,
    in_words,
    integer,
    number,
    one_of,
    part,
    pose,
)

NAN, INF = float("nan"), float("inf")


@dataclasses.dataclass(frozen=True)
class Part:
    size: int = 1
    colour: str = "red"


WHOLE, PAIRS = "whole number from 0 to 10", "n x 2 finite numbers"


@pytest.mark.parametrize(
    ("check", "value", "limits", "text"),
    [
        *((number, bad, {}, "it is ") for bad in ("2", None, True, np.True_, 1j, [2.0])),
        (number, -1e-9, {"low": 0}, "of 0 or more"),
        (number, 0.0, {"low": 0, "above": True}, "above 0"),
        (number, 1e-310, {"low": 0, "above": True}, "of 1e-30 or more"),
        (number, 10**400, {"finite": False}, "from -1e+12 to 1e+12"),
        (integer, 10**400, {"low": 1}, "from 1 to 2^128"),
        (number, 1.1, {"low": 0, "high": 1}, "from 0 to 1"),
        (number, 0, {"low": 0, "high": 1, "above": True}, "above 0 to 1"),
        (number, INF, {}, "from -1e+12 to 1e+12"),
        (number, INF, {"low": 0}, "from 0 to 1e+12"),
        (number, 10**400, {"low": 0}, "from 0 to 1e+12"),
        (number, 10.0000001, {"high": 10}, "it is 10.0000001"),
        (array, [[1e308, 0]], {"shape": (None, 2)}, "of at most 1e+12"),
        (number, -INF, {"low": 0, "finite": False}, "-inf"),
        (number, NAN, {"finite": False}, "that is not NaN"),
        *((integer, bad, {"high": 10}, WHOLE) for bad in (1.0, "1", None, True, np.True_, -1, 11)),
        *((array, bad, {"shape": (None, 2)}, PAIRS) for bad in (
            None, 5.0, "abc", {}, [1, 2], [[1, 2, 3]], [[1], [2, 3]], [[1, NAN]], [[INF, 1]],
            [["a", "b"]], np.array([["a", "b"]] * 9), [[1j, 2]], np.ma.array([[1, 2]], mask=True))),
        (array, [1, True], {"shape": (2,)}, "2 finite numbers"),
        (pose, (1, 2, 90), {}, "90° would be 1.571"),
        (pose, (1, 2), {}, "it has shape 2"),
        (pose, (1, 2, NAN), {}, "nan"),
        (one_of, "appel", {"valid": ["apple", "pear"]},
         "unknown it 'appel': did you mean 'apple'? allowed values: apple, pear."),
        (one_of, "xyz", {"valid": ["apple"]}, "unknown it 'xyz': allowed values: apple."),
        (one_of, "xyz", {"valid": []}, "allowed values: none."),
        *((one_of, bad, {"valid": ["pear"]}, "unknown it") for bad in (3, ["pear"], np.eye(2))),
    ],
)  # fmt: skip
def test_what_is_refused_is_refused_in_one_sentence(check, value, limits, text):
    with refused(text):
        check("it", value, **limits)


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int64(2)])
def test_numbers_of_any_kind_up_to_the_limits_are_returned_as_pythons(value):
    seen = number("it", value, low=2, high=2)
    assert (seen, type(seen)) == (2.0, float)
    assert number("it", INF, low=0, finite=False) == INF
    whole = integer("it", np.int32(value), low=2, high=2)
    assert (whole, type(whole)) == (2, int)
    assert one_of("fruit", "pear", ["apple", "pear"]) == "pear"
    assert pose("it", (1, value, -math.pi)) == (1.0, 2.0, -math.pi)


@pytest.mark.parametrize(
    "say", [lambda text: str(InputError(text)), lambda t: in_words(OSError(t))]
)
def test_a_sentence_is_short_and_on_one_line_without_control_characters(say):
    assert say("an\x1b[31m\a\n odd\0name\udce9").endswith(r"an\x1b[31m\x07 odd\x00name\udce9")
    for text in ("x" * 10**7, "\x1b" * 10**4):
        assert 1000 < len(say(text)) < 2100
    assert say("Σ w = 1, 神经").endswith("Σ w = 1, 神经")
    assert issubclass(InputError, ValueError)  # for callers who know nothing of this package


def test_array_returns_fresh_float64_of_the_shape_asked_for():
    given = np.array([[1, 2], [3, 4]], dtype=np.float64)
    seen = array("it", given, (None, 2))
    assert seen.dtype == np.float64
    assert not np.shares_memory(seen, given)
    assert np.array_equal(seen, given)
    assert array("it", [], (None,)).shape == (0,)


def test_part_takes_itself_nothing_or_changes_to_the_default():
    default = Part(size=7)
    assert part("part", Part, None, default) is default
    assert part("part", Part, Part(2), default) == Part(2)
    assert part("part", Part, {"colour": "blue"}, default) == Part(7, "blue")
    for value, text in (({"color": 1}, "did you mean 'colour'"), (5, "size, colour")):
        with pytest.raises(InputError, match=text):
            part("part", Part, value, default)


@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(-LARGEST, LARGEST),
    st.booleans(),
)
def test_a_refused_number_is_told_with_its_bounds_to_the_last_bit(value, bound, above):
    try:
        number("it", value, low=bound, high=LARGEST, above=above)
    except InputError as refused:
        told = re.fullmatch(r"it is (\S+), but .*(?:from|above) (\S+) to (\S+)\.", str(refused))
        assert tuple(map(float, told.groups())) == (value, bound, LARGEST)
    else:
        assert bound <= value <= LARGEST


def test_numbers_are_told_with_as_few_digits_as_tell_them_apart():
    said = ["10", "0.1", "10.0000001", "1e+308"]
    assert [digits(x) for x in (10.0, 0.1, 10.0000001, 1e308)] == said


@pytest.mark.parametrize("kind", [np.float32, np.float16, fractions.Fraction])
def test_the_numbers_of_a_part_are_pythons_own(kind):
    parts = [
        MotionNoise(drive=kind(0.5)),
        Robot(radius=kind(0.5)),
        Start(sd_heading=kind(0.5)),
        Lap(step=kind(0.5)),
        Driver(look_ahead=kind(0.5)),
        Route(clearance=kind(0.5)),
        Lidar(sigma=kind(0.5), beams=np.int16(3)),
        Office(seed=np.int64(3)),
        GridMap(occupancy=np.zeros((2, 2), int), resolution=kind(0.5)),
    ]
    for given_part in parts:
        for field in dataclasses.fields(given_part):
            value = getattr(given_part, field.name)
            if isinstance(value, numbers.Real):
                assert type(value) in (int, float, bool)
