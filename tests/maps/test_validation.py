"""The checks behind every refusal: what they let through, and that they answer in one sentence."""

import math

import numpy as np
import pytest
from refusals import refused

from deqmcl_gym import validation
from deqmcl_gym.validation import InputError, array, in_words, integer, number, one_of, pose

NAN, INF = float("nan"), float("inf")
WHOLE, PAIRS = "whole number from 0 to 10", "n x 2 finite numbers"


@pytest.mark.parametrize(
    ("check", "value", "limits", "text"),
    [
        *((number, bad, {}, "it is ") for bad in ("2", None, True, np.True_, 1j, [2.0])),
        (number, 0.0, {"low": 0, "above": True}, "above 0"),
        (number, 1e-310, {"low": 0, "above": True}, "of 1e-30 or more"),
        (array, [[1e308, 0]], {"shape": (None, 2)}, "of at most 1e+12"),
        (number, -INF, {"low": 0, "finite": False}, "-inf"),
        (number, NAN, {"finite": False}, "that is not NaN"),
        *((integer, bad, {"high": 10}, WHOLE) for bad in (1.0, "1", None, True, np.True_, -1, 11)),
        *((array, bad, {"shape": (None, 2)}, PAIRS) for bad in (
            None, 5.0, "abc", {}, [1, 2], [[1, 2, 3]], [[1], [2, 3]], [[1, NAN]], [[INF, 1]],
            [["a", "b"]], np.array([["a", "b"]] * 9), [[1j, 2]], np.ma.array([[1, 2]], mask=True))),
        (pose, (1, 2, 90), {}, "90° would be 1.571"),
        (one_of, "appel", {"valid": ["apple", "pear"]},
         "unknown it 'appel': did you mean 'apple'? allowed values: apple, pear."),
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


def test_numbers_are_told_with_as_few_digits_as_tell_them_apart():
    said = ["10", "0.1", "10.0000001", "1e+308"]
    assert [validation.digits(x) for x in (10.0, 0.1, 10.0000001, 1e308)] == said
