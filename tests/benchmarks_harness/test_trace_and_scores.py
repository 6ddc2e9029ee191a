"""Which states each score covers, on hand-made episodes."""

import json
import math

import fake_episode
import msgspec
import numpy as np
import pytest
from fake_episode import IN_WALL, TASK, USABLE, FakeBelief, mean_error, one_point, traced, truth_of

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.episode import Step
from benchmarks.trials.scores import groups_named
from benchmarks.trials.scoring import SCORE_NAMES, TrialRecord, error_profile, record, scores
from benchmarks.trials.trace import JourneyLog, Trace
from deqmcl_gym.validation import InputError

T, L = 10, 3
OFFSETS = (0, -L, L)
USUAL = Thresholds()
# sums of up to ten terms around 10² … 10⁴ with the roundings of x = 100 + s + error
CLOSE = {"rel": 1e-12}


def scored(trace):
    return {row["offset"]: row for row in scores(trace)}


def recorded(trace):
    return json.loads(msgspec.json.encode(record(trace)))


@pytest.mark.parametrize(
    ("offset", "states"),
    [
        (0, range(1, T + 1)),  # not s = 0: the prior is not an estimate
        (-L, range(1, T - L + 1)),  # x_0, seen at t = L, is left out too
        (+L, range(L, T + 1)),  # from what was foreseen at t = 0
    ],
)
def test_the_error_is_the_mean_over_the_states_from_1_that_an_offset_estimates(offset, states):
    row = scored(traced(T, OFFSETS))[offset]
    assert row["error"] == pytest.approx(mean_error(states, offset), **CLOSE)
    window = range(L, T - L + 1)  # the same for every offset
    assert row["error_window"] == pytest.approx(mean_error(window, offset), **CLOSE)


def test_without_a_lag_the_window_is_the_whole_lap():
    row = scored(traced(T, (0,)))[0]
    whole = pytest.approx(mean_error(range(1, T + 1), 0), **CLOSE)
    assert row["error_window"] == row["error"] == whole


@pytest.mark.parametrize("held", [(0, -8), (0, 8, 2)])
def test_offsets_that_a_method_does_not_hold_have_no_row_and_no_place_in_the_profile(held):
    trace = traced(40, held, (0, -8, 8))
    assert set(scored(trace)) == set(held) - {2}  # which is not scored
    assert set(error_profile(trace)) == set(held)


def test_only_states_of_the_lap_that_were_held_are_scored_even_if_others_are_believed_in():
    everything = FakeBelief({k: (truth_of(0)[None], np.ones(1)) for k in OFFSETS})
    moments = [Step(t, truth_of(t), USABLE, everything, 0.0) for t in range(T + 1)]
    for trace in (traced(T, OFFSETS), Trace(moments, OFFSETS, TASK)):
        states = {offset: kept.states.tolist() for offset, kept in trace.offsets.items()}
        assert states == {0: [*range(T + 1)], -L: [*range(T - L + 1)], L: [*range(L, T + 1)]}


def test_a_lag_longer_than_the_episode_leaves_the_present_and_no_window():
    lag = 10**15
    rows = scored(traced(T, (0, -lag, lag)))
    assert set(rows) == {0}
    assert rows[0]["error"] == pytest.approx(mean_error(range(1, T + 1), 0), **CLOSE)
    assert math.isnan(rows[0]["error_window"])


def test_position_and_heading_scores_are_roots_of_mean_squares_from_state_1():
    def off(state, offset):
        return truth_of(state)[None] + [3.0 * state, 4.0 * state, 0.01 * state], np.ones(1)

    row = scored(traced(T, (0,), points=off))[0]
    rms = math.sqrt(sum(s * s for s in range(1, T + 1)) / T)
    assert row["position_rmse"] == pytest.approx(5 * rms, **CLOSE)
    assert row["heading_rmse"] == pytest.approx(0.01 * rms, **CLOSE)


def test_variances_and_entropy_are_means_over_steps_from_state_1():
    def pair(state, offset):  # x = truth ± s: variance s²; nothing else varies
        return truth_of(state) + np.array([[state, 0, 0], [-state, 0, 0]]), np.full(2, 0.5)

    row = scored(traced(T, (0,), points=pair))[0]
    assert row["var_x"] == pytest.approx(sum(s * s for s in range(1, T + 1)) / T, **CLOSE)
    assert [row["var_y"], row["var_cos"], row["var_sin"]] == pytest.approx([0, 0, 0], abs=1e-30)
    constant = 2 * math.log(2 * math.pi * math.e) + 0.5 * math.log(1e-2 * 1e-6 * 1e-6)
    expected = constant + sum(math.log(s) for s in range(1, T + 1)) / T
    assert row["entropy"] == pytest.approx(expected, **CLOSE)


def test_a_belief_of_one_point_is_scored_by_its_distance_alone():
    row = scored(traced(T, (0,)))[0]
    assert row["energy_score"] == row["error"] == pytest.approx(mean_error(range(1, T + 1), 0))
    assert math.isfinite(row["position_rmse"])
    needs_a_spread = ("var_x", "var_y", "var_cos", "var_sin", "entropy", "coverage_50", "nees")
    assert all(math.isnan(row[name]) for name in needs_a_spread)


def test_wall_share_is_the_mean_weight_where_the_robot_does_not_fit():
    def partly(state, offset):  # all inside at s = 0, which is not scored; then 0.3
        shares = (0.0, 1.0) if state == 0 else (0.7, 0.3)
        return np.array([fake_episode.FREE, IN_WALL]), np.array(shares)

    assert scored(traced(T, (0,), points=partly))[0]["wall_share"] == pytest.approx(0.3, **CLOSE)


@pytest.mark.parametrize(
    ("action", "share"),
    [
        (lambda step: None, 0.1),  # only the pose in the wall
        (lambda step: np.array([0.0, 3.0]), 0.1),  # turned on the spot
        (lambda step: np.array([60.0, 0.0]), 0.1 + 0.5),  # from the block, from beyond the wall
        (lambda step: np.array([41.0, 0.0]), 0.1),  # from 1 px clear of them
        (lambda step: np.array([0.0, 60.0, 0.0]), 0.1 + 0.4),  # sideways, from beyond the wall
        (lambda step: np.array([60.0, 0.0]) if step == T else None, 0.1 + 0.5 / T),
    ],
)
def test_wall_step_share_is_the_weight_whose_commanded_step_passed_through_a_wall(action, share):
    # in the middle of the left corridor, headed to its wall, to the block and along both
    x, y = 50.0, 150.0
    poses = np.array([(x, y, math.pi), (x, y, 0.0), (x, y, -math.pi / 2), IN_WALL])
    weights = np.array([0.2, 0.3, 0.4, 0.1])
    trace = traced(T, (0,), points=lambda state, offset: (poses, weights), action=action)
    assert scored(trace)[0]["wall_step_share"] == pytest.approx(share, **CLOSE)


@pytest.mark.parametrize("offset", OFFSETS)
def test_outlier_share_is_the_weight_far_from_the_truth_over_the_common_states(offset):
    def partly(state, offset):  # 60 px off, the rest 20 px
        off = np.array([[0, 60.0, 0], [20.0, 0, 0]])
        return truth_of(state) + off, np.array([state, T - state]) / T

    shares = [s / T for s in range(L, T - L + 1)]
    rows = scored(traced(T, OFFSETS, points=partly))
    assert rows[offset]["outlier_share"] == pytest.approx(np.mean(shares), **CLOSE)


def test_a_record_without_a_score_is_refused():
    plain = msgspec.to_builtins(record(traced(T, OFFSETS)))
    del plain["scores"][0]["error"]
    with pytest.raises(msgspec.ValidationError, match="has no error among its scores"):
        msgspec.convert(plain, TrialRecord)


@pytest.mark.parametrize(
    ("astray", "thresholds", "lost"),
    [
        (13, USUAL, 1.0),  # 80 px in the last states: 13 · 80 / 20 = 52
        (12, USUAL, 0.0),  # 12 · 80 / 20 = 48
        (12, Thresholds(lost=47.0), 1.0),
        (12, Thresholds(lost_steps=19), 1.0),  # 12 · 80 / 19 = 50.5
    ],
)
def test_a_trial_is_lost_if_its_last_states_are_far_off_on_average(astray, thresholds, lost):
    def off(state, offset):
        return truth_of(state)[None] + [80.0 * (state > 40 - astray), 0, 0], np.ones(1)

    assert scored(traced(40, (0,), points=off, thresholds=thresholds))[0]["lost"] == lost


def test_coverage_is_the_share_of_states_whose_truth_is_ranked_inside():
    # five points at -2 … 2 px; the truth stands between them and is nearer than k of five
    def around(state, offset):
        k = state % 5 if state else 4
        xs = np.arange(-2.0, 3.0) - (0.0, 0.5, 0.5, 1.5, 2.5)[k]
        return truth_of(state) + np.column_stack([xs, np.zeros((5, 2))]), np.full(5, 0.2)

    row = scored(traced(10, (0,), points=around))[0]
    ranks = [(0.0, 0.2, 0.2, 0.6, 1.0)[s % 5] for s in range(1, 11)]
    for level in (50, 80, 95):
        expected = sum(rank <= level / 100 for rank in ranks) / 10
        assert row[f"coverage_{level}"] == pytest.approx(expected, **CLOSE)


def test_the_profile_has_every_offset_over_the_same_states():
    steps, lag = 40, 8
    held = range(-lag, lag + 1)
    trace = traced(steps, held, (0, -lag, lag))
    expected = {k: mean_error((10, 15, 20, 25, 30), k) for k in range(-8, 9, 2)}
    assert error_profile(trace) == pytest.approx(expected, **CLOSE)


def test_a_belief_is_scored_as_it_was_when_it_was_given():
    class Reused:  # one array for all steps, written into before each
        poses, weights = np.empty((1, 3)), np.ones(1)

        def points(self, offset=0):
            return self.poses, self.weights

    def moments():
        for t in range(T + 1):
            Reused.poses[:] = np.add(truth_of(t), (t, 0, 0))
            yield Step(t, truth_of(t), USABLE, Reused(), 0.0)

    error = recorded(Trace(moments(), OFFSETS, TASK))["curves"]
    assert {k: curve["first_state"] for k, curve in error.items()} == {"0": 0, "-3": 0, "3": L}
    assert error["0"]["error"] == [*range(T + 1)]
    assert error[str(L)]["error"] == [abs(t - L) for t in range(T - L + 1)]
    assert error[str(-L)]["error"] == [t + 2 * L for t in range(T - L + 1)]


def test_scans_used_counts_those_after_the_start_with_at_least_one_usable_beam():
    nan, inf, limit = math.nan, math.inf, TASK.max_range
    beams = [(10.0, 10.0), (10.0, 10.0), (nan, 10.0), (nan, nan)]  # that of t = 0 nobody sees
    beams += [(inf, -inf), (-1.0, limit + 1), (0.0, nan), (limit, nan)]
    used = [t > 0 and any(0 <= beam <= limit for beam in scan) for t, scan in enumerate(beams)]
    trace = traced(len(beams) - 1, (0,), ranges=lambda t: np.array(beams[t], np.float32))
    assert trace.scans_used == sum(used) == 4
    assert trace.steps == len(beams) - 1


def test_the_time_of_a_trial_leaves_the_reset_out():
    assert traced(4, (0,)).seconds == 4 * 0.25


def rated(*qualities):
    """The trace of an episode whose beliefs have these qualities at t = 0, 1, …"""
    beliefs = [FakeBelief({0: one_point(t, 0)}, quality) for t, quality in enumerate(qualities)]
    moments = [Step(t, truth_of(t), USABLE, belief, 0.0) for t, belief in enumerate(beliefs)]
    return Trace(moments, (0,), TASK)


def test_the_quality_is_kept_of_every_step_and_recorded_from_the_first_with_all_digits():
    trace = rated(0.99, 0.25, None, 1 - 2**-53)
    assert np.array_equal(trace.quality, [0.99, 0.25, math.nan, 1 - 2**-53], equal_nan=True)
    assert recorded(trace)["quality"] == [0.25, None, 1 - 2**-53]


def test_where_no_belief_gives_a_quality_none_is_recorded():
    assert recorded(traced(T, OFFSETS))["quality"] is None
    assert recorded(rated(0.99, None, None))["quality"] is None  # nothing of a scan is known


@pytest.mark.parametrize("quality", [1.5, -0.1, math.nan, "good"])
def test_a_quality_that_is_no_probability_fails_the_trial(quality):
    with pytest.raises(InputError, match="quality"):
        rated(0.99, quality)


def test_a_record_is_strict_json_with_null_for_what_is_unknown():
    result = recorded(traced(T, OFFSETS, thresholds=Thresholds(far=40.0)))
    (present,) = (row for row in result["scores"] if row["offset"] == 0)
    assert [*present] == ["offset", *SCORE_NAMES]
    assert present["entropy"] is None
    assert result["steps_done"] == result["scans_used"] == T
    assert result["unit"] == "px"
    assert result["thresholds"] == {"far": 40.0, "lost": 50.0, "lost_steps": 20}


@pytest.mark.parametrize("silent", [range(T + 1), [4], [T]])
def test_a_belief_without_points_of_the_present_is_refused_at_whatever_step(silent):
    held = [{} if t in silent else {0: one_point(t, 0)} for t in range(T + 1)]
    moments = [Step(t, truth_of(t), USABLE, FakeBelief(own), 0.0) for t, own in enumerate(held)]
    said = f"its belief of state {silent[0]} holds no points of the present"
    with pytest.raises(InputError, match=said):
        Trace(moments, (0,), TASK)


@pytest.mark.parametrize(
    "points", [(np.zeros((2, 2)), np.full(2, 0.5)), (np.zeros((0, 3)), np.zeros(0)), ("a", "b")]
)
def test_what_is_no_belief_is_refused_by_name_in_whole_runs_too(points):
    moments = [Step(0, truth_of(0), USABLE, FakeBelief({0: points}), 0.0)]
    with pytest.raises(InputError, match="its belief of state 0 at offset 0 has"):
        Trace(moments, (0,), TASK, JourneyLog(TASK, groups_named(["lost"])))


def test_a_belief_may_be_lists_in_whole_runs_too():
    believed = FakeBelief({0: ([[100.0, 50.0, 0.5], [101.0, 50.0, 0.5]], [0.5, 0.5])})
    forth = np.array([1.0, 0.0])
    moments = [Step(t, truth_of(t), USABLE, believed, 0.0, forth if t else None) for t in (0, 1)]
    asked = JourneyLog(TASK, groups_named(["lost", "ambiguity"]))
    found = Trace(moments, (0,), TASK, asked)
    scores = record(found).journey.scores
    assert (scores["metres_to_localize"], scores["mass_split"]) == (0, 0)
