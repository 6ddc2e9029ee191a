"""The checks behind every refusal: what they let through, and that they answer in one sentence."""

import dataclasses
import math

import numpy as np
import pytest

from deqmcl_gym import validation
from deqmcl_gym.validation import InputError

NAN, INF = float("nan"), float("inf")


def refusal(check, *args, **kwargs) -> str:
    with pytest.raises(InputError) as caught:
        check(*args, **kwargs)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    return sentence


def test_a_refusal_is_a_value_error_on_one_line_even_where_it_shows_an_array():
    error = InputError(f"this is {np.eye(3)!r}.")
    assert isinstance(error, ValueError)
    assert str(error) == "this is array([[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]])."


def test_one_of_returns_the_name_or_names_the_nearest():
    assert validation.one_of("fruit", "pear", ["apple", "pear"]) == "pear"
    assert refusal(validation.one_of, "fruit", "appel", ["apple", "pear"]) == (
        "unknown fruit 'appel': did you mean 'apple'? allowed values: apple, pear."
    )
    assert refusal(validation.one_of, "fruit", "xyz", ["apple"]) == (
        "unknown fruit 'xyz': allowed values: apple."
    )
    assert refusal(validation.one_of, "fruit", "xyz", []).endswith("allowed values: none.")


@pytest.mark.parametrize("name", [None, 3, ["pear"], np.zeros((2, 2))])
def test_one_of_refuses_what_is_no_string(name):
    assert "unknown fruit" in refusal(validation.one_of, "fruit", name, ["pear"])


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int64(2)])
def test_number_returns_a_float(value):
    seen = validation.number("it", value, low=2, high=2)
    assert (seen, type(seen)) == (2.0, float)


@pytest.mark.parametrize("value", [NAN, "2", None, True, np.True_, 1j, [2.0], np.zeros((2, 2))])
def test_number_refuses_what_is_no_number(value):
    assert refusal(validation.number, "it", value).startswith("it is ")


@pytest.mark.parametrize(
    ("limits", "value", "allowed"),
    [
        ({"low": 0}, -1e-9, "of 0 or more"),
        ({"low": 0, "above": True}, 0.0, "above 0"),
        ({"low": 0, "high": 1}, 1.1, "from 0 to 1"),
        ({"low": 0, "high": 1, "above": True}, 0, "above 0 to 1"),
        ({}, INF, "that is finite"),
        ({"low": 0}, INF, "of 0 or more"),
        ({"finite": False}, NAN, "that is not NaN"),
    ],
)
def test_number_refuses_what_is_out_of_its_limits_and_says_them(limits, value, allowed):
    assert allowed in refusal(validation.number, "it", value, **limits)


def test_number_takes_infinity_only_where_it_need_not_be_finite():
    assert validation.number("it", INF, low=0, finite=False) == INF
    assert "inf" in refusal(validation.number, "it", INF, low=0)
    assert "-inf" in refusal(validation.number, "it", -INF, low=0, finite=False)


@pytest.mark.parametrize("value", [3, np.int32(3)])
def test_integer_returns_an_int(value):
    seen = validation.integer("it", value, low=3, high=3)
    assert (seen, type(seen)) == (3, int)


@pytest.mark.parametrize("value", [1.0, 1.5, NAN, "1", None, True, np.True_, -1, 11])
def test_integer_refuses_what_is_no_whole_number_within_the_limits(value):
    assert "whole number from 0 to 10" in refusal(validation.integer, "it", value, high=10)


def test_array_returns_fresh_float64_of_the_shape_asked_for():
    given = np.array([[1, 2], [3, 4]], dtype=np.float64)
    seen = validation.array("it", given, (None, 2))
    assert seen.dtype == np.float64
    assert not np.shares_memory(seen, given)
    assert np.array_equal(seen, given)
    assert validation.array("it", [], (None,)).shape == (0,)


@pytest.mark.parametrize(
    "value",
    [
        None,
        5.0,
        "abc",
        [1, 2],
        [[1, 2, 3]],
        [[1], [2, 3]],
        [[1, NAN]],
        [[INF, 1]],
        [["a", "b"]],
        np.array([["a", "b"]] * 9),
        {},
    ],
)
def test_array_refuses_other_shapes_and_what_is_not_finite_numbers(value):
    assert "n x 2 finite numbers" in refusal(validation.array, "it", value, (None, 2))


def test_pose_refuses_a_heading_in_degrees_and_says_its_radians():
    assert validation.pose("it", (1, 2, -math.pi)) == (1.0, 2.0, -math.pi)
    assert "90° would be 1.571" in refusal(validation.pose, "it", (1, 2, 90))
    assert "it has shape 2" in refusal(validation.pose, "it", (1, 2))
    assert "nan" in refusal(validation.pose, "it", (1, 2, NAN))


@dataclasses.dataclass(frozen=True)
class Part:
    size: int = 1
    colour: str = "red"


def test_part_takes_itself_nothing_or_changes_to_the_default():
    default = Part(size=7)
    assert validation.part("part", Part, None, default) is default
    assert validation.part("part", Part, Part(2), default) == Part(2)
    assert validation.part("part", Part, {"colour": "blue"}, default) == Part(7, "blue")


def test_part_refuses_an_unknown_key_with_the_nearest_and_what_is_no_mapping():
    assert "did you mean 'colour'" in refusal(validation.part, "part", Part, {"color": 1}, Part())
    assert "size, colour" in refusal(validation.part, "part", Part, 5, Part())
