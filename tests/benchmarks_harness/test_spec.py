"""What names a trial and where its randomness comes from; what makes its result out of date."""

import json
import math
from dataclasses import fields, replace
from pathlib import Path

import pytest
from deqmcl_command import python
from refusals import refused

from benchmarks import trials
from benchmarks.setup.overrides import Named, Overrides, of_json
from benchmarks.sweeps import Sweep
from benchmarks.tables.panels import trial_words
from benchmarks.trials import Method, Trial

PARAMS = {"lag": 20, "particles": 1000}
TRIAL = Trial(scenario="paper", localizer="deq-mcl", params=PARAMS, lag=20, seed=0, trial=3)
CHANGED = {
    "scenario": "matched",
    "world": {"lidar.beams": 9},
    "assumed": {"scan.sigma": 50.0},
    "disturbance": ({"kind": "kidnap", "step": 100},),
    "localizer": "mcl",
    "params": {"lag": 20, "particles": 1001},
    "agent": Named("stale"),
    "lag": 21,
    "seed": 1,
    "trial": 4,
    "filter_seed": 1,
}
WORLD = {"seed", "trial"}  # what the world depends on
FILTER = WORLD | {"filter_seed"}  # what the localizer's randomness depends on


def stream(trial):
    return trial.filter_rng().integers(2**63, size=4).tolist()


@pytest.mark.parametrize("field", [field.name for field in fields(Trial)])
def test_every_field_is_in_the_name_of_a_result_and_few_are_in_the_seeds(field):
    other = replace(TRIAL, **{field: CHANGED[field]})  # KeyError: a new field needs a case here
    assert other.key("p") != TRIAL.key("p")
    assert (other.world_seed != TRIAL.world_seed) == (field in WORLD)
    assert (stream(other) != stream(TRIAL)) == (field in FILTER)


def test_a_name_is_of_the_trial_and_what_computes_it_whatever_the_order_of_parameters():
    key = TRIAL.key("p")
    assert len(key) == 32
    assert set(key) <= set("0123456789abcdef")
    backwards = {"particles": 1000, "lag": 20}
    assert replace(TRIAL, params=backwards).key("p") == key != TRIAL.key("q")


def test_world_seeds_differ_and_are_whole_numbers_that_any_json_reader_holds_exactly():
    seeds = [replace(TRIAL, seed=s, trial=i).world_seed for s in range(5) for i in range(400)]
    # 2,000 random numbers below 2**53 collide with probability 2e-10
    assert len(set(seeds)) == len(seeds)
    assert all(isinstance(seed, int) and 0 <= seed < 2**53 for seed in seeds)
    assert max(seeds) > 2**52  # the range is used


def test_values_that_are_other_json_are_other_methods_and_are_read_back_as_they_were():
    alike = [1, 1.0, True, 0, 0.0, -0.0, False, math.inf, "inf", "'inf", "''inf", "-inf", -math.inf]
    methods = [Method("m", {"way": (value, {"of": value})}) for value in alike]
    assert len(set(methods)) == len(alike)
    for method in methods:
        again = Overrides(of_json(json.loads(json.dumps(method.json()["params"], allow_nan=False))))
        assert again == method.params
        assert repr(again) == repr(method.params)
    sweep = Sweep(title="s", localizers=methods, trials=1, takes=lambda name: None)
    assert len(sweep.distinct()) == len(alike)


def test_changes_told_by_tables_are_those_by_dotted_name_and_by_part_they_are_nested():
    told = Overrides.told("world", {"lidar": {"beams": 9}, "floor_plan": {"office": {"seed": 3}}})
    assert told == {"lidar.beams": 9, "floor_plan.office.seed": 3}
    nested = {"floor_plan": {"office": {"seed": 3}}, "lidar": {"beams": 9}}
    assert told.by_part(("lidar", "floor_plan"), "part") == nested
    with refused("world names lidar.beams twice"):
        Overrides.told("world", {"lidar.beams": 9, "lidar": {"beams": 9}})


def test_files_of_a_world_are_found_beside_a_folder_and_shown_without_it():
    world = Overrides({"floor_plan": {"file": "a.yaml"}, "log": ["l.csv", "/m.csv"], "map.x": "b"})
    beside = world.beside(Path("/data"))
    assert beside["floor_plan"]["file"] == "/data/a.yaml"
    assert beside["log"] == ("/data/l.csv", "/m.csv")
    assert beside["map.x"] == "b"
    assert beside.files == ["/data/l.csv", "/m.csv", "/data/a.yaml"]  # parts of a log
    assert "log l.csv" in trial_words(replace(TRIAL, world={"log": "/data/l.csv"}))


ROOT = Path(trials.__file__).parents[2]

RUN = """
import sys
import benchmarks.setup.logs, benchmarks.trials.tracks  # of trials on a log
from benchmarks.trials.stage import attempt, key_of
from benchmarks.trials import Trial
from pathlib import Path
executed = set()
see = lambda frame, event, _: executed.add(frame.f_code.co_filename)
few = (("particles", 20),)
for scenario, name, params in (
    ("paper", "mcl", few), ("guided", "deq-mcl", few), ("driving", "dead-reckoning", ())
):
    trial = Trial(
        scenario=scenario, localizer=name, params=params, lag=2, seed=0, trial=0,
        disturbance=((("kind", "dropout"), ("probability", 0.1)),),
    )
    key = key_of(trial)
    assert attempt(trial, key).record  # its kernels are compiled
    sys.setprofile(see)
    attempt(trial, key)
    sys.setprofile(None)
print(*(name for name in sys.modules if name.partition(".")[0] == "benchmarks"))
folders = [Path(sys.argv[1], name) for name in ("deqmcl_gym", "localizers", "benchmarks")]
print(*(path for path in executed if any(map(Path(path).is_relative_to, folders))))
"""


def modules(package):
    path = ROOT / package.replace(".", "/")
    if not path.is_dir():
        return {package}
    return {f"{package}.{own.stem}".removesuffix(".__init__") for own in path.glob("*.py")}


@pytest.fixture(scope="module")
def seen():
    """Modules of the harness that trials load, and files of ours that they execute."""
    loaded, executed = python("-c", RUN, ROOT).splitlines()
    return set(loaded.split()) - {"benchmarks"}, {Path(path) for path in executed.split()}


def test_the_digest_covers_exactly_the_modules_of_the_harness_that_a_trial_loads(seen):
    loaded, _ = seen
    covered = {p: modules(p) for p in trials.PACKAGES if p.startswith("benchmarks.")}
    assert loaded <= set().union(*covered.values())
    for package in ("benchmarks.trials", "benchmarks.setup"):
        assert covered[package] <= loaded


def test_the_digest_covers_every_file_that_a_trial_executes(seen):
    _, executed = seen
    covered = {path for package in trials.PACKAGES for path, _ in trials._files(package)}
    assert len(executed) > 40
    assert executed <= covered


@pytest.fixture
def digest_of(monkeypatch, tmp_path):
    """The digest of a world where each package has one file, given by package."""

    def digest(files):
        for package in trials.PACKAGES:
            (tmp_path / f"{package}.py").write_text(files.get(package, ""))
        trials.code_digest.cache_clear()
        return trials.code_digest()

    monkeypatch.setattr(trials, "_files", lambda p: [(tmp_path / f"{p}.py", "part.py")])
    yield digest
    trials.code_digest.cache_clear()


def test_the_digest_changes_with_any_file_that_a_trial_runs(digest_of):
    digests = {digest_of({package: "changed"}) for package in trials.PACKAGES}
    assert len(digests | {digest_of({})}) == len(trials.PACKAGES) + 1


DOCUMENTED = '''
"""A module."""
def f(x: int = 1, *, y=()):
    """A function."""
    return x[1:], f"{x!r:>{y}}"  # a comment
class C:
    """A class."""
'''
BARE = """
def f(x: int=1, *, y=()):
    return (
        x[1 : ],
        f'{x!r:>{y}}',
    )
class C: 'another text'
"""


@pytest.mark.parametrize(
    "other", ["x[:1]", "x[1:], y", "x[1.0:]", "x['1':]", "x[True:]", "x[b'1':]", "x[-1:]", "x[1]"]
)
def test_the_digest_is_of_what_code_does_whatever_its_words_and_layout(digest_of, other):
    package = trials.PACKAGES[0]
    same = digest_of({package: DOCUMENTED})
    assert digest_of({package: BARE}) == same
    assert digest_of({package: DOCUMENTED.replace("x[1:]", other)}) != same
