"""What unknown cells count as: said to Log-v0, a scenario of a log, a sweep and a replay."""

import pytest
from hall import recorded_in_a_hall

from benchmarks.cli import main
from benchmarks.setup.names import scenario
from benchmarks.sweeps.sweepfile import read_sweep
from benchmarks.trials.stage import Stage
from deqmcl_gym import logs
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.maps import GridMap
from deqmcl_gym.validation import InputError

WORDS = ("obstacle", "transparent", "free")
ENV = 'log = "lap.csv"\nmap = "hall.yaml"\nreference = "lap.tum"\nsegment = 1.0\n'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with a log and a map."""
    monkeypatch.chdir(tmp_path)
    hall, log = recorded_in_a_hall(steps=30)
    hall.save("hall.yaml")
    logs.Trajectory(log.times, log.reference).write("lap.tum")
    logs.write(logs.Log(log.scanner, log.times, log.odometry, log.ranges, None, "m"), "lap.csv")
    return tmp_path


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


def test_unknown_cells_are_obstacles_unless_something_else_is_said(folder):
    assert LogEnv(log="lap.csv", map="hall.yaml").floor_plan.unknown == "obstacle"


@pytest.mark.parametrize("given", [None, "hall.json", ((0, 0), (9, 0), (9, 9)), "a map"])
def test_a_map_that_is_no_yaml_has_no_unknown_cells_to_speak_of(folder, given):
    floor_plan = GridMap.load("hall.yaml") if given == "a map" else given
    with pytest.raises(InputError, match=r"^unknown is 'free' and map is .*: give its path as map"):
        LogEnv(log="lap.csv", map=floor_plan, unknown="free")


def test_an_unknown_word_is_refused(folder):
    with pytest.raises(
        InputError,
        match="unknown value of unknown 'wall': allowed values: free, obstacle, transparent",
    ):
        LogEnv(log="lap.csv", map="hall.yaml", unknown="wall")


@pytest.mark.parametrize(
    ("word", "said"), [(None, "obstacles, which stop beams"), ("transparent", "but no beam")]
)
def test_a_replay_says_what_unknown_cells_were(folder, capsys, word, said):
    more = () if word is None else ("--unknown", word)
    told = ("--start=1,1,0", "--localizers", "dead-reckoning", "--seeds", "1", "--jobs", "1")
    assert main(["replay", "lap.csv", "--map", "hall.yaml", *told, *more, "--out", "o"]) == 0
    assert said in capsys.readouterr().out
    assert said in (folder / "o" / "report.html").read_text()
