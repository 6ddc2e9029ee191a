"""deqmcl_gym/Log-v0: a log comes out of it as it went in, and the truth by one way only."""

import contextlib
import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from bags import written
from drives import ENDINGS, NAN, SQUARE, episode, real, recorded_in_a_hall, same, write_lap
from hypothesis import given
from hypothesis import strategies as st
from refusals import refused

import deqmcl_gym  # noqa: F401  # registers the envs
from benchmarks.cli import main
from benchmarks.robots import replay_of
from benchmarks.setup.names import scenario
from benchmarks.sweeps.sweepfile import read_sweep
from benchmarks.trials.stage import Stage
from deqmcl_gym import logs
from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.envs.wrappers import RecordLog
from deqmcl_gym.logs.motion import lengths_of
from deqmcl_gym.maps import GridMap, PolygonMap
from deqmcl_gym.validation import InputError

LOG_ID = "deqmcl_gym:deqmcl_gym/Log-v0"
PATCHY = real(n=400, seed=1)  # a reference at 7 of 10 records
WORDS = ("obstacle", "transparent", "free")
ENV = 'log = "lap.csv"\nmap = "hall.yaml"\nreference = "lap.tum"\nsegment = 1.0\n'


def played(env, seed=None):
    said = [(*env.reset(seed=seed), 0.0, False, False)]
    while not said[-1][3]:
        scan, reward, ended, truncated, info = env.step(env.unwrapped.next_action)
        said.append((scan, info, reward, ended, truncated))
    return said


def of_walls(changes):
    return {f"world.changed_walls.{name}": value for name, value in changes.items()}


def test_the_map_of_a_log_is_out_of_date_if_asked_and_nothing_else_is(tmp_path):
    hall, log = recorded_in_a_hall(steps=40)
    plain = LogEnv(log=log, map=hall)
    changes = [{"share": 0.5, "seed": seed} for seed in (0, 0, 1)]
    first, again, other = (LogEnv(log=log, map=hall, changed_walls=one) for one in changes)
    changed = first.floor_plan.occupancy != hall.occupancy
    assert changed.any()
    np.testing.assert_array_equal(first.floor_plan.occupancy, again.floor_plan.occupancy)
    assert (first.floor_plan.occupancy != other.floor_plan.occupancy).any()
    assert first.floor_plan.free(log.reference, 0.16).all()
    for one, same_one in zip(played(first), played(plain), strict=True):
        np.testing.assert_equal(one, same_one)
    wrong = {"changed_walls.share is 0.9": {"share": 0.9}, "changed_walls is 0.3": 0.3}
    for words, bad in wrong.items():
        with refused(words):
            LogEnv(log=log, map=hall, changed_walls=bad)
    logs.write(log, tmp_path / "x.npz")
    hall.save(tmp_path / "x.yaml")
    walls = {"share": 0.5, "seed": 1}
    replay = replay_of(tmp_path / "x.npz", tmp_path / "x.yaml", settings=of_walls(walls))
    told = replay.scenario.recording()[1].occupancy
    assert ((told != hall.occupancy) & (hall.occupancy == 100)).any()
    assert any("changed on purpose" in fact and "share 0.5" in fact for fact in replay.facts)
    with refused("changed_walls.share is 0.9"):
        settings = of_walls({"share": 0.9})
        replay_of(tmp_path / "x.npz", tmp_path / "x.yaml", settings=settings)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_room_played_back_from_a_file_says_what_the_room_said(tmp_path, ending):
    lidar = {"mounting": (-4.0, 6.0)}  # px; the robot's radius is 8
    room = RecordLog(gym.make("deqmcl_gym/Room-v0", preset="sharp", horizon=20, lidar=lidar))
    said = [room.reset(seed=5)]
    while len(said) < 60:
        scan, _, _, _, info = room.step(said[-1][1]["planned_actions"][0])
        said.append((scan, info))
    written(room.log, tmp_path / f"x{ending}")
    env = gym.make(LOG_ID, log=tmp_path / f"x{ending}", horizon=20)
    assert env.unwrapped.lidar.mounting == pytest.approx(lidar["mounting"])
    back = played(env)
    assert len(back) == len(said)
    for t, (scan, info) in enumerate(said):
        again, told, reward, ended, truncated = back[t]
        np.testing.assert_array_equal(again, scan)
        np.testing.assert_array_equal(told["command"][[0, 2]], info["command"])
        np.testing.assert_allclose(told["command"][1], 0, atol=1e-9)  # no room's robot strafes
        np.testing.assert_allclose(told["truth"], info["truth"], rtol=0, atol=1e-12)
        to_come = np.array([info["command"] for _, info in said[t + 1 : t + 21]]).reshape(-1, 2)
        shown = told["planned_actions"][: told["planned_count"], [0, 2]]
        np.testing.assert_array_equal(shown, to_come)
        assert set(told) == set(info)
        assert (reward, ended, truncated) == (0.0, t == len(said) - 1, False)
    with pytest.raises(RuntimeError, match="has ended"):
        env.step(np.zeros(3, np.float32))


def test_truth_is_told_where_a_reference_is_and_by_no_other_way():
    log = real()
    blind = logs.Log(log.scanner, log.times, log.odometry, log.ranges)
    for one, other in zip(played(LogEnv(log=log)), played(LogEnv(log=blind)), strict=True):
        one[1].pop("truth", None)
        np.testing.assert_equal(one, other)  # all the rest is the same without a reference
        assert "truth" not in other[1]
    told = [said[1]["truth"] for said in played(LogEnv(log=log))]
    np.testing.assert_array_equal(told, np.nan_to_num(log.reference, nan=np.inf))


def test_another_action_than_the_recorded_one_is_refused_or_ignored():
    wrong = np.float32([0.3, 0.0, 0.3])
    for handling in ("error", "ignore"):
        env = LogEnv(log=real(), on_mismatch=handling)
        env.reset()
        if handling == "error":
            with pytest.raises(InputError, match="was recorded"):
                env.step(wrong)
            assert env.elapsed_steps == 0
        else:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                info = env.step(wrong)[4]
            np.testing.assert_array_equal(info["command"], env._actions[0])
        for bad in ([NAN, 0.0, 0.0], [0.0, 0.0], "abc", None):
            with pytest.raises(InputError, match="the action"):
                env.step(bad)


def test_what_is_planned_is_the_odometry_or_nothing():
    log = episode()
    by_odometry, nothing = (LogEnv(log=log, plan=plan, horizon=7) for plan in ("odometry", "none"))
    shown = by_odometry.reset()[1]["planned_actions"]
    np.testing.assert_array_equal(shown, log.increments[:7].astype(np.float32))
    info = nothing.reset()[1]
    assert (info["planned_count"], info["planned_actions"].tolist()) == (0, [[0, 0, 0]] * 7)


def test_a_segment_is_played_before_it_is_thinned():
    log = real(50)
    env = LogEnv(log=log, start=10, length=20, every=(0.3, 9.0))
    assert env.log.times[0] == log.times[10]
    assert env.log.times[-1] <= log.times[29]
    np.testing.assert_array_equal(env.log.times, log.segment(10, 20).spaced(0.3, 9.0).times)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"log": 3}, "path of a log"),
        ({"log": None}, "there is no log: give log="),
        ({"mpa": "x.yaml"}, "keyword argument 'mpa': did you mean 'map'"),
        ({"map": PolygonMap(((0, 0), (9, 0), (9, 9)))}, "the map is in px, but the log in m"),
        ({"plan": "truth"}, "plan"),
        ({"on_mismatch": "sigh"}, "on_mismatch"),
        ({"every": (1e3, 1e3)}, "needs 2 or more"),
        ({"reference": 3}, "the reference is 3"),
        ({"log": "x.log", "reading": {"topic": "/scan"}}, "key in reading"),
        ({"segment": 0}, "segment is 0"),
    ],
)
def test_a_bad_argument_is_refused_in_one_sentence(options, said):
    with pytest.raises(InputError, match=said) as caught:
        LogEnv(**({"log": real()} | options))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("length", [1e-17, 1e-11])
def test_a_segment_has_a_step_or_is_refused(length):
    log = real()
    far = replace(log, odometry=log.odometry + np.array([1e9, 0.0, 0.0]))
    with contextlib.suppress(InputError):
        env = LogEnv(log=far, segment=length, render_mode="rgb_array")
        env.reset(seed=0)
        env.step(env.next_action)
        assert env.render().ndim == 3  # of odometry beyond all maps


@pytest.mark.parametrize("map_", [None, SQUARE])
def test_a_picture_has_even_sides_and_changes_as_the_robot_drives(map_):
    env = LogEnv(log=real(), map=map_, render_mode="rgb_array")
    env.reset()
    first = env.render()
    env.step(env.next_action)
    assert first.shape[0] % 2 == first.shape[1] % 2 == 0
    assert (env.render() != first).any()


def test_a_bad_reset_is_refused():
    env = LogEnv(log=real())
    for name, value in (("options", 5), ("seed", -1), ("seed", "a")):
        with pytest.raises(InputError, match=f"{name} is {value!r}"):
            env.reset(**{name: value})


def test_the_recorder_takes_any_of_our_envs_and_keeps_what_wrappers_did():
    log = real()
    env = RecordLog(LogEnv(log=log, every=(0.1, 0.1)))
    with pytest.raises(RuntimeError, match="call reset"):
        _ = env.log
    said = played(env)
    np.testing.assert_allclose(env.log.increments[0], said[1][1]["command"], atol=1e-6)
    assert len(env.log) == len(said)
    assert RecordLog(RoomEnv(), truth=False).reset(seed=0)


def test_a_record_stays_as_it_was_whatever_the_caller_does_to_info():
    logs_kept = []
    for spoil in (False, True):
        env = RecordLog(RoomEnv())
        _, info = env.reset(seed=0)
        for _ in range(5):
            scan, *_, info = env.step(info["planned_actions"][0].copy())
            if spoil:
                for array in (scan, info["command"], info["truth"]):
                    array[...] = 3
        logs_kept.append(env.log)
    same(*logs_kept)


@pytest.mark.parametrize("env", [gym.make("Pendulum-v1"), RoomEnv(observation="dict")])
def test_the_recorder_refuses_an_env_without_scans(env):
    with pytest.raises(InputError, match="scans of deqmcl_gym's envs"):
        RecordLog(env)
    with pytest.raises(InputError, match="truth is 'no'"):
        RecordLog(RoomEnv(), truth="no")


@given(st.floats(0.1, 0.4), st.integers(0, 2**31))
def test_a_segment_goes_so_far_and_is_referenced_throughout(length, seed):
    log = PATCHY
    env = LogEnv(log=log, segment=length, horizon=5)
    env.reset(seed=seed)
    first = log.times.tolist().index(env.record.time)
    assert env.expected_start == env.log[first].reference
    said = [info for _, info, *_ in played(env, seed)[1:]]
    driven = lengths_of(env.log.increments[first : first + len(said)])
    assert driven[:-1].sum() < length <= driven.sum() + 1e-9
    assert all("truth" in info for info in said)
    left = len(said)
    for t, info in enumerate(said, 1):
        assert info["planned_count"] == min(5, left - t)
        assert not info["planned_actions"][info["planned_count"] :].any()


def test_segments_are_drawn_by_the_seed_alone():
    dense = episode(60)
    env = LogEnv(log=dense, segment=100.0)

    def times(seed, count=8):
        return [env.reset(seed=seed if k == 0 else None) and env.record.time for k in range(count)]

    assert times(3) == times(3) != times(4)
    assert len(set(times(3, 20))) > 5


@pytest.fixture
def folder(here):
    write_lap(recorded_in_a_hall(steps=30), here)
    return here


@pytest.mark.parametrize("word", WORDS)
def test_the_env_a_scenario_and_a_sweep_have_the_map_that_is_asked_for(folder, word):
    env = LogEnv(log="lap.csv", map="hall.yaml", unknown=word)
    assert env.floor_plan is GridMap.load("hall.yaml", word)
    (folder / "hall.toml").write_text(f'base = "log"\n[env]\n{ENV}unknown = "{word}"\n')
    assert scenario("hall.toml").room().floor_plan.unknown == word
    (folder / "sweep.toml").write_text(
        f'scenario = "log"\ntrials = 1\nlocalizers = ["dead-reckoning"]\n[world]\n{ENV}'
        '[[vary]]\n"world.unknown" = ["obstacle", "transparent", "free"]\n'
    )
    trials = read_sweep(folder / "sweep.toml").distinct()
    assert {Stage.of(one).room.floor_plan.unknown for one in trials} == set(WORDS)
    assert LogEnv(log="lap.csv", map="hall.yaml").floor_plan.unknown == "obstacle"


@pytest.mark.parametrize("given", [None, "hall.json", ((0, 0), (9, 0), (9, 9)), "a map"])
def test_a_map_that_is_no_yaml_has_no_unknown_cells_and_an_unknown_word_is_refused(folder, given):
    floor_plan = GridMap.load("hall.yaml") if given == "a map" else given
    words = r"^the map is .* must be a \.yaml file where unknown is given"
    with pytest.raises(InputError, match=words):
        LogEnv(log="lap.csv", map=floor_plan, unknown="free")
    with refused("unknown value of unknown 'wall': allowed values: free, obstacle, transparent"):
        LogEnv(log="lap.csv", map="hall.yaml", unknown="wall")


@pytest.mark.parametrize(
    ("word", "said"), [(None, "obstacles, which stop beams"), ("transparent", "but no beam")]
)
def test_a_replay_says_what_unknown_cells_were(folder, capsys, word, said):
    more = () if word is None else ("--set", f"world.unknown={word}")
    told = ("--start=1,1,0", "--localizers", "dead-reckoning", "--seeds", "1", "--jobs", "1")
    assert main(["replay", "lap.csv", "--map", "hall.yaml", *told, *more, "--out", "o"]) == 0
    assert said in capsys.readouterr().out
    assert said in (folder / "o" / "report.html").read_text()
