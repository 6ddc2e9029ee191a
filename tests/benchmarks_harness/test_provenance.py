"""What makes a result out of date: any code that a trial runs, and no other."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

from benchmarks import trials
from benchmarks.trials import provenance

RUN = """
import sys
import benchmarks.setup.log_scenario  # whose trials load a log
from benchmarks.trials.attempt import attempt
from benchmarks.trials.plugins import key_of
from benchmarks.trials.spec import Trial
for name in ("mcl", "deq-mcl", "dead-reckoning"):
    trial = Trial(
        scenario="paper", localizer=name, params=(), lag=2, seed=0, trial=0,
        disturbance=((("kind", "dropout"), ("probability", 0.1)),),
    )
    assert attempt(trial, key_of(trial)).record
print(*(name for name in sys.modules if name.partition(".")[0] == "benchmarks"))
"""


def modules(package):
    """Names of the modules of a package of ours, itself included."""
    root = Path(trials.__file__).parents[2]
    path = root / package.replace(".", "/")
    if not path.is_dir():
        return {package}
    return {f"{package}.{own.stem}".removesuffix(".__init__") for own in path.glob("*.py")}


def test_the_digest_covers_exactly_the_modules_of_the_harness_that_a_trial_loads():
    done = subprocess.run(
        [sys.executable, "-c", RUN], capture_output=True, text=True, check=False, timeout=120
    )
    loaded = set(done.stdout.split()) - {"benchmarks"}
    covered = {p: modules(p) for p in provenance.PACKAGES if p.startswith("benchmarks.")}
    reading = modules("benchmarks.files")  # hands a file on as it is, or refuses it
    assert loaded - reading <= set().union(*covered.values()), done.stderr
    for package in ("benchmarks.trials", "benchmarks.setup"):
        assert covered[package] <= loaded


def test_the_digest_changes_with_any_file_of_the_world_and_of_the_localizers(monkeypatch, tmp_path):
    def digest():
        provenance.code_digest.cache_clear()
        return provenance.code_digest()

    for package in ("benchmarks", *provenance.PACKAGES):
        (tmp_path / package).mkdir()
        (tmp_path / package / "part.py").write_text("")
    monkeypatch.setattr(
        provenance,
        "find_spec",
        lambda package: SimpleNamespace(
            origin=tmp_path / package / "__init__.py", submodule_search_locations=[]
        ),
    )
    try:
        seen = {digest()}
        for path in ("deqmcl_gym/part.py", "localizers/part.py", "benchmarks.trials/part.py"):
            (tmp_path / path).write_text("changed")
            seen.add(digest())
        (tmp_path / "localizers" / "part.py").rename(tmp_path / "localizers" / "other.py")
        seen.add(digest())
        assert len(seen) == 5
        (tmp_path / "benchmarks" / "part.py").write_text("a report")
        assert digest() in seen
    finally:
        provenance.code_digest.cache_clear()
