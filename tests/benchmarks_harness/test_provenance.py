"""What makes a result out of date: any code that a trial runs, and no other."""

from pathlib import Path

import pytest
from deqmcl_command import python

from benchmarks import trials
from benchmarks.trials import spec

ROOT = Path(trials.__file__).parents[2]

RUN = """
import sys
import benchmarks.setup.logs, benchmarks.trials.tracks  # of trials on a log
from benchmarks.trials.stage import attempt, key_of
from benchmarks.trials.spec import Trial
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
    """Names of the modules of a package of ours, itself included."""
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
    covered = {p: modules(p) for p in spec.PACKAGES if p.startswith("benchmarks.")}
    assert loaded <= set().union(*covered.values())
    for package in ("benchmarks.trials", "benchmarks.setup"):
        assert covered[package] <= loaded


def test_the_digest_covers_every_file_that_a_trial_executes(seen):
    _, executed = seen
    covered = {path for package in spec.PACKAGES for path, _ in spec._files(package)}
    assert len(executed) > 50
    assert executed <= covered


@pytest.fixture
def digest_of(monkeypatch, tmp_path):
    """The digest of a world where each package has one file, given by package."""

    def digest(files):
        for package in spec.PACKAGES:
            (tmp_path / f"{package}.py").write_text(files.get(package, ""))
        spec.code_digest.cache_clear()
        return spec.code_digest()

    monkeypatch.setattr(spec, "_files", lambda p: [(tmp_path / f"{p}.py", "part.py")])
    yield digest
    spec.code_digest.cache_clear()


def test_the_digest_changes_with_any_file_that_a_trial_runs(digest_of):
    digests = {digest_of({package: "changed"}) for package in spec.PACKAGES}
    assert len(digests | {digest_of({})}) == len(spec.PACKAGES) + 1


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
    package = spec.PACKAGES[0]
    same = digest_of({package: DOCUMENTED})
    assert digest_of({package: BARE}) == same
    assert digest_of({package: DOCUMENTED.replace("x[1:]", other)}) != same
