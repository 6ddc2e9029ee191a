"""Bad parameters and inputs are refused on one line and change nothing; odd scans are counted."""

import math

import numpy as np
import pytest
from following import follow, same

import localizers
from deqmcl_gym.maps import Lidar
from deqmcl_gym.validation import InputError

NAN, INF = math.nan, math.inf
RNG = np.random.default_rng


def sentence(caught) -> str:
    text = str(caught.value)
    assert "\n" not in text
    assert text.endswith(".")
    return text


@pytest.mark.parametrize(
    ("name", "params", "words"),
    [
        ("mcl", {"particles": 0}, "particles is 0"),
        ("mcl", {"particles": np.zeros((2, 2))}, "particles is"),
        ("mcl", {"particles": 10**9}, "particles is 1,000,000,000, which would take 19 GiB"),
        ("mcl", {"resampler": "low-variance"}, "multinomial, stratified, systematic"),
        ("mcl", {"ess_threshold": 1.1}, "ess_threshold is 1.1, but must be a number from 0 to 1"),
        ("mcl-smoother", {"lag": -1}, "lag is -1"),
        ("mcl-map", {"beta": NAN}, "beta is nan"),
        ("deq-mcl", {"pilots": 0}, "pilots is 0"),
        ("mcl", {"particels": 10}, "did you mean 'particles'"),
        ("mcl", {"lag": 3}, "ess_threshold, particles, resampler"),
        ("dead-reckoning", {"particles": 10}, "none"),
        ("deqmcl", {}, "did you mean 'deq-mcl'"),
        (None, {}, "unknown localizer None"),
    ],
)
def test_a_bad_parameter_is_refused_with_what_is_allowed(robot, name, params, words):
    with pytest.raises(InputError) as caught:
        localizers.make(name, robot, **params)
    assert words in sentence(caught)


def test_a_robot_with_a_bad_radius_is_refused(room):
    with pytest.raises(InputError) as caught:
        localizers.RobotModel(floor_plan=room, lidar=Lidar(), radius=-1)
    assert sentence(caught).startswith("radius is")


@pytest.mark.parametrize("name", localizers.names())
def test_update_before_reset_says_what_to_do(robot, name):
    with pytest.raises(RuntimeError) as caught:
        localizers.make(name, robot).update([100.0], [5.0, 0.0], [])
    assert "call reset(prior, plan, rng) first" in sentence(caught)


BAD_PLANS = [None, 5.0, "abc", [1, 2], [[1, 2], [3]], [[1, NAN]], np.full((40, 2), "x")]
BAD_PLANS += [np.array([[5.0, 0.0], [5.0, -INF]]), np.ones((4, 3))]
BAD_ACTIONS = [None, "ab", [1, 2, 3], [0, INF], []]
BAD_ACTIONS += [np.array([5.0, NAN]), np.ones((1, 2)), np.ones((2, 1), np.float32)]
BAD_SCANS = [None, ["a"], [1, 2], [[1], [2, 3]], np.ones(2), np.ones((1, 2), np.float32)]
BAD_INPUTS = [
    *[("action", bad) for bad in BAD_ACTIONS],
    *[("plan", bad) for bad in BAD_PLANS],
    *[("scan", bad) for bad in BAD_SCANS],
]


@pytest.mark.parametrize("name", ["deq-mcl", "dead-reckoning"])
@pytest.mark.parametrize("plan", BAD_PLANS[:2], ids=str)
def test_a_bad_plan_is_refused_at_reset_and_the_localizer_stays_unstarted(robot, prior, name, plan):
    localizer, rng = localizers.make(name, robot), RNG(0)
    with pytest.raises(InputError) as caught:
        localizer.reset(prior, plan, rng)
    assert sentence(caught).startswith("the plan")
    with pytest.raises(RuntimeError):
        localizer.update([100.0], [5.0, 0.0], [])
    assert rng.bit_generator.state == RNG(0).bit_generator.state


@pytest.mark.parametrize(("what", "bad"), BAD_INPUTS, ids=str)
def test_a_bad_input_to_update_is_refused_and_changes_nothing(robot, prior, drive, what, bad):
    actions, scans = drive
    localizer = localizers.make("deq-mcl", robot, particles=50)
    localizer.reset(prior, actions, RNG(0))
    good = {"scan": scans[0], "action": actions[0], "plan": actions[1:]}
    with pytest.raises(InputError) as caught:
        localizer.update(*{**good, what: bad}.values())
    assert sentence(caught).startswith(f"the {what}")
    fresh = localizers.make("deq-mcl", robot, particles=50)
    undisturbed = follow(fresh, prior, (actions[:1], scans[:1]), plans=[actions, actions[1:]])
    assert same([localizer.update(*good.values())], undisturbed[1:], offsets=range(-2, 13))


def test_a_scan_of_another_lidar_is_refused_with_both_numbers_of_beams(robot, prior):
    localizer = localizers.make("mcl", robot)
    localizer.reset(prior, [], RNG(0))
    with pytest.raises(InputError, match=r"shape \(3,\).* lidar of 1 beams"):
        localizer.update([1.0, 2.0, 3.0], [5.0, 0.0], [])


@pytest.mark.parametrize("bad", [NAN, -INF, -0.5, 400.5])
def test_a_bad_beam_is_counted_and_an_all_bad_scan_is_no_update(robot, prior, bad):
    localizer = localizers.make("mcl", robot, particles=40)
    localizer.reset(prior, [], RNG(0))
    belief = localizer.update([bad], [5.0, 0.0], [])
    assert (belief.events.skipped_beams, belief.events.blind_scans) == (1, 1)
    assert belief.points()[1].tolist() == [1 / 40] * 40
    after = localizer.update([200.0], [5.0, 0.0], [])
    assert (after.events.skipped_beams, after.events.blind_scans) == (1, 1)
    assert np.ptp(after.points()[1]) > 0


def test_a_scan_with_some_bad_beams_is_not_blind(room, prior):
    robot = localizers.RobotModel(floor_plan=room, lidar=Lidar(beams=3))
    localizer = localizers.make("mcl", robot, particles=40)
    localizer.reset(prior, [], RNG(0))
    belief = localizer.update([NAN, 200.0, -1.0], [5.0, 0.0], [])
    assert (belief.events.skipped_beams, belief.events.blind_scans) == (2, 0)
    assert np.ptp(belief.points()[1]) > 0
