"""A sweep file: what it says, and how it is refused; ours, and those beside reports."""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from refusals import refused

from benchmarks.setup.overrides import Overrides
from benchmarks.sweeps import MOST_TRIALS
from benchmarks.sweeps.running import check
from benchmarks.sweeps.sweepfile import SUITES, read_sweep, sweep_named, with_localizers
from benchmarks.tables.stats import least_worlds
from benchmarks.trials.stage import provenance_of
from deqmcl_gym.validation import InputError
from localizers import absolute_name

ALL = """
title = "Everything that a file can say"
scenario = "sharp"
lag = 7
seed = 3
trials = 2
filter_seeds = 2
localizers = ["mcl", { name = "deq-mcl", params = { beta = inf } }]
disturbance = [{ kind = "kidnap", step = 100 }]

[world]
noise.drive = 0.04
"lidar.beams" = 9

[assumed.scan]
sigma = 50

[params]
particles = 30

[[vary]]
lag = [5, 6]
world.lidar.sigma = [5.0, 20.0]

[[vary]]
params.pilots = [1, 2, 3]
"""
REPORTS = Path(__file__).parents[2] / "docs" / "reports"
BESIDE = [path.relative_to(REPORTS).as_posix() for path in sorted(REPORTS.glob("*/*.toml"))]
MADE = [name for name in (*SUITES, *BESIDE) if name != "basin" and "/log-" not in name]  # need logs


def read(tmp_path, text):
    path = tmp_path / "my-sweep.toml"
    path.write_text(text)
    return read_sweep(path)


def test_everything_said_in_a_file_reaches_the_trials(tmp_path):
    sweep = read(tmp_path, ALL)
    assert sweep.title == "Everything that a file can say"
    assert sweep.combinations == 2 * 3 * 2 * 2 * 2
    trials = sweep.distinct()
    assert {t.scenario for t in trials} == {"sharp"}
    assert {t.seed for t in trials} == {3}
    assert {(t.trial, t.filter_seed) for t in trials} == {(0, 0), (0, 1), (1, 0), (1, 1)}
    assert {t.assumed for t in trials} == {Overrides({"scan.sigma": 50})}
    assert {t.disturbance for t in trials} == {(Overrides({"kind": "kidnap", "step": 100}),)}
    # walked together: lag 5 with sigma 5, lag 6 with sigma 20
    assert {(t.lag, dict(t.world)["lidar.sigma"]) for t in trials} == {(5, 5.0), (6, 20.0)}
    assert {dict(t.world)["lidar.beams"] for t in trials} == {9}
    assert {dict(t.world)["noise.drive"] for t in trials} == {0.04}
    mcl = {t.params for t in trials if t.localizer == "mcl"}
    deq_mcl = [dict(t.params) for t in trials if t.localizer == "deq-mcl"]
    assert mcl == {Overrides({"particles": 30})}  # it has no use for the others
    assert {p["pilots"] for p in deq_mcl} == {1, 2, 3}
    kept = {(p["beta"], p["lag"], p["particles"]) for p in deq_mcl}
    assert kept == {(math.inf, 5, 30), (math.inf, 6, 30)}


def test_what_a_file_does_not_say_is_as_in_the_paper_and_its_name_is_the_title(tmp_path):
    sweep = read(tmp_path, 'localizers = ["mcl"]')
    assert sweep.title == "my-sweep"
    (first, *rest) = sweep.distinct()
    assert len(rest) == 9
    assert (first.scenario, first.lag, first.seed, first.filter_seed) == ("paper", 20, 0, 0)
    assert (first.world, first.assumed, first.disturbance, first.params) == ({}, {}, (), {})


def test_the_file_in_the_documents_says_what_they_say_of_it(tmp_path):
    document = Path(__file__).parents[2] / "docs" / "sweeps.md"
    text, changed, *_ = re.findall(r"```toml\n(.*?)\n```", document.read_text(), re.DOTALL)
    sweep = read(tmp_path, text)
    assert sweep.combinations == 1440
    assert f"= {sweep.combinations} trials" in document.read_text()
    check(sweep)
    (tmp_path / "mine.py").write_text(OWN.format(parameter="own"))
    assert read(tmp_path, changed).names == ["mcl-map", "mine.py:Own"]


OWN = """
class Own:
    def __init__(self, robot, {parameter}=1):
        pass

    def reset(self, prior, plan, rng): ...

    def update(self, ranges, action, plan): ...
"""
NAMING_OWN = """
localizers = ["{name}", {{ name = "mcl" }}]
baseline = "{name}"
params = {{ theirs = 3 }}
"""


@pytest.mark.parametrize("name", ["sub/../own.py:Own", "{}/own.py:Own", "own.py"])
def test_a_localizer_in_a_file_is_found_beside_it_from_any_folder(tmp_path, monkeypatch, name):
    folder, elsewhere = tmp_path / "file's", tmp_path / "current"
    for place, parameter in ((folder, "theirs"), (elsewhere, "other")):
        place.mkdir()
        (place / "own.py").write_text(OWN.format(parameter=parameter))
    monkeypatch.chdir(elsewhere)
    found = read(folder, NAMING_OWN.format(name=name.format(folder)))
    own = f"{folder}/own.py:Own" if name.startswith("{}") else "own.py:Own"  # as it is said
    assert found.names == [own, "mcl"]
    assert [*map(absolute_name, found.names)] == [f"{folder}/own.py:Own", "mcl"]
    assert found.baseline == own
    assert dict(found.distinct()[0].params) == {"theirs": 3}
    monkeypatch.chdir(folder)
    assert with_localizers(found, ["./own.py:Own"]).names == [own, "mcl"]  # it is there already


def test_two_files_of_one_name_are_not_taken_for_each_other(tmp_path, monkeypatch):
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    for folder, parameter in ((tmp_path, "theirs"), (here, "other")):
        (folder / "own.py").write_text(OWN.format(parameter=parameter))
    found = with_localizers(read(tmp_path, 'localizers = ["own.py:Own"]'), ["own.py:Own"])
    with refused("two files are called own.py:Own"):
        provenance_of(found.cells())


def test_a_sweep_with_a_base_is_that_one_with_the_keys_given_here_replaced_whole(tmp_path):
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "base.toml").write_text(ALL)
    found = read(tmp_path, 'base = "below/base.toml"\ntrials = 9\nparams = {}\n')
    base = read_sweep(tmp_path / "below" / "base.toml")
    assert found == replace(base, title="my-sweep", trials=9, params=())
    lost = replace(sweep_named("lost"), title="Mine")
    assert read(tmp_path, 'title = "Mine"\nbase = "lost"') == lost


def test_a_base_that_leads_back_to_its_file_or_nowhere_is_refused(tmp_path):
    (tmp_path / "other.toml").write_text('base = "./my-sweep.toml"')
    with refused("other.toml: base is './my-sweep.toml', which is this file"):
        read(tmp_path, 'base = "other.toml"')
    with refused("base 'lots': did you mean 'lost'?", ".toml"):
        read(tmp_path, 'base = "lots"')


def test_an_action_with_a_third_number_is_repeated_so_many_times(tmp_path):
    def change(actions):
        plan = f'{{ kind = "plan-change", step = 1, actions = {actions} }}'
        return read(tmp_path, f'localizers = ["mcl"]\ndisturbance = [{plan}]')

    drive, turn = [5.0, 0.0], [0.0, 1.0]
    assert change([[*drive, 2], turn]) == change([drive, drive, turn])
    with refused("steps of an action is 0"):
        change([[*drive, 0]])


BAD = [  # a file, and what the sentence must name
    ("", ["localizers", "missing"]),
    ('localizers = ["mcl"', ["not valid TOML", "Unclosed"]),
    ('localizers = "mcl"', ["localizers", "'mcl'", "list"]),
    ("localizers = [{ nam = 'mcl' }]", ["'nam'", "did you mean 'name'?"]),
    ("localizers = [{ name = 'mcl', lable = 'a' }]", ["'lable'", "did you mean 'label'?"]),
    (
        "localizers = [{ name = 'mcl', label = 'a' }, { name = 'ekf', label = 'a' }]",
        ["the label 'a' is of several localizers"],
    ),
    ('localizers = ["mcl"]\ntrials = 1.5', ["trials", "1.5", "whole"]),
    ('localizers = ["mcl"]\nworld = 3', ["world", "3", "table"]),
    ('localizers = ["mcl"]\n[world]\nnoise.drive = 1\n"noise.drive" = 2', ["noise.drive", "twice"]),
    ('localizers = ["mcl"]\n[world]\nnoise.drive = nan', ["world.noise.drive", "nan"]),
    ('localizers = ["mcl"]\n[vary]\nlag = [1]', ["vary", "[[vary]]"]),
    ('localizers = ["mcl"]\n[[vary]]\nlag = []', ["lag", "empty"]),
    ('localizers = ["mcl"]\n[[vary]]\nlag = [1, 2]\nworld.x = [3]', ["lag: 2", "x: 1"]),
    ('localizers = ["mcl"]\n[[vary]]\nlag = [1]\n[[vary]]\nlag = [2]', ["lag", "twice"]),
    ('localizers = ["mcl"]\n[[vary]]\ntrials = [1, 2]', ["'trials'", "params.…"]),
    ('localizers = ["mcl"]\nbaseline = "mcl-map"', ["baseline", "'mcl-map'"]),
    ('localizers = ["mcl"]\ndisturbance = ["kidnap"]', ["'kidnap'", "{kind = "]),
    ('localizers = ["mcl"]\nagent = 3', ["agent is 3", "a name, or {name"]),
    ('localizers = ["mcl"]\n[[vary]]\nagent.shift = [1.0]', ["agent.shift", "no agent is named"]),
    ('localizers = ["mcl"]\nagent = "stale"\nbaseline = "mcl-plan"', ["baseline", "stale"]),
    ('localizers = ["mcl"]\n[[vary]]\nagents = ["stale"]', ["'agents'", "did you mean 'agent'"]),
    ("a = " + "[" * 10**5, ["nested too deeply"]),
    ("a = " + "1" * 5000, ["valid TOML: Exceeds the limit (4300 digits)"]),
]


@pytest.mark.parametrize(("text", "named"), BAD, ids=[text[:40] or "empty" for text, _ in BAD])
def test_a_bad_file_is_refused_with_the_name_of_file_and_key(tmp_path, text, named):
    with refused("my-sweep.toml", *named):
        read(tmp_path, text)


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with refused("gone.toml does not exist"):
        read_sweep(tmp_path / "gone.toml")
    with refused("is a folder"):
        read_sweep(tmp_path)


def test_a_file_is_read_with_or_without_a_mark_and_another_encoding_is_named(tmp_path):
    path, text = tmp_path / "own.toml", 'title = "θ"\nlocalizers = ["mcl"]\ntrials = 3\n'
    for ending in ("\r\n", "\r"):
        path.write_bytes(text.replace("\n", ending).encode("utf-8-sig"))
        assert read_sweep(path) == read(tmp_path, text)
    path.write_bytes(text.encode("iso-8859-7"))
    with refused("is not UTF-8 (byte 0xe8 in line 1)"):
        read_sweep(path)


def test_a_sweep_of_more_trials_than_a_folder_can_hold_is_counted_and_refused(tmp_path):
    text = 'localizers = ["mcl"]\ntrials = 100000\nfilter_seeds = '
    assert read(tmp_path, f"{text}10").combinations == MOST_TRIALS
    axis = f"[[vary]]\nworld.noise.drive = {list(range(400))}\n"
    with refused("has 4,000,000,000,000 trials, more than 1,000,000"):
        read(tmp_path, f"{text}100000\n{axis}")


def test_a_misspelt_suite_or_localizer_added_to_one_is_refused_with_the_nearest():
    with refused("'quik': did you mean 'quick'?", ".toml"):
        sweep_named("quik")
    with pytest.raises(InputError, match=r"'dec-mcl': did you mean 'deq-mcl'\?") as caught:
        sweep_named("quick", ["dec-mcl"])
    assert "toml" not in str(caught.value)


def test_a_sweep_file_of_another_ending_is_told_how_it_must_end(tmp_path):
    (tmp_path / "mine.conf").write_text('localizers = ["mcl"]')
    for name in (f"{tmp_path}/mine.conf", "/dev/stdin"):
        with refused(f"is the file {name}", "must end in .toml"):
            sweep_named(name)


@pytest.mark.parametrize("name", MADE)
def test_every_built_in_suite_and_every_sweep_beside_its_report_can_be_made(name):
    check(sweep_named(str(REPORTS / name) if name in BESIDE else name))


def test_a_localizer_added_to_a_suite_runs_on_its_worlds_and_one_it_has_is_not_added():
    quick = sweep_named("quick")
    assert with_localizers(quick, ["mcl"]) == quick
    noise = with_localizers(sweep_named("noise"), ["ekf", "ekf"])
    assert [method.name for method in noise.localizers].count("ekf") == 1
    worlds = [t.world for t in noise.distinct() if t.localizer == "ekf"]
    assert worlds == [t.world for t in noise.distinct() if t.localizer == "mcl"]


def test_the_quick_look_has_worlds_enough_to_tell_with_two_methods_of_ones_own():
    quick = sweep_named("quick")
    assert quick.trials >= least_worlds(len(quick.localizers) - 1 + 2)
