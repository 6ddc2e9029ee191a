"""The folder of a sweep: what is run again, what is refused, who may use it, what can be read."""

import json
import math
import shutil

from deqmcl_command import exit_code, files, lose, records, stored
from sweep_command import broken, report, sweep, tables, write_small

import localizers
from benchmarks.sweeps.results import results_in
from benchmarks.trials import stage


def test_only_a_trial_that_is_lost_or_damaged_is_run_again_and_the_tables_come_back(
    file, finished, copy, ran, capsys
):
    before = records(copy)
    lose(copy, 1)
    path = copy / "trials.jsonl"
    path.write_text(path.read_text().replace('"steps_done":204', '"steps_done":203', 1))
    (copy / "results.csv").unlink()
    assert sweep(file, copy) == 0
    assert len(ran) == 2
    assert {**records(copy), **before} == before
    assert tables(copy) == tables(finished)
    said = "is not as it was written; it is left out."
    assert capsys.readouterr().err == f"deqmcl: {path}, line 1 {said}\n"


def test_another_sweep_in_the_folder_is_refused_with_all_differences(copy, tmp_path, refusal):
    before = files(copy)
    another = write_small(tmp_path, trials=1, particles=16, more="\n[world]\nnoise.drive = 0.5")
    differences = "trials was 2 and is 1", "particles was 15 and is 16", "was not set and is 0.5"
    refusal(["sweep", another, "--out", copy], *differences, "--out")
    assert files(copy) == before


def test_changed_code_is_refused_and_named(file, copy, refusal, monkeypatch):
    monkeypatch.setattr(stage, "code_digest", lambda: "other")
    monkeypatch.setattr(stage, "versions", lambda: {"numpy": "0.1"})
    changed = "code was", "libraries.numpy was", "libraries.numba was"
    refusal(["sweep", file, "--out", copy], *changed)


@localizers.registered("broken", broken)
def test_results_of_other_code_can_be_read_and_infinity_is_a_number(tmp_path, monkeypatch):
    more = "\n[[vary]]\nparams.beta = [inf, 1.0]\n"
    file, out = write_small(tmp_path, trials=1, more=more), tmp_path / "out"
    assert sweep(file, out, "--with", "mcl-map,broken") == 3
    monkeypatch.setattr(stage, "code_digest", lambda: "other")
    found = results_in(out)
    assert (len(found.records), len(found.failures), found.missing) == (4, 2, 0)
    betas = [dict(r.trial.params).get("beta") for r in found.records]
    assert betas == [None, None, math.inf, 1.0]  # mcl and dead reckoning have none


PLUG_IN = """
from localizers.methods.classical import dead_reckoning
from pathlib import Path
Path(__file__).with_name("ran").open("a").write("{}")
def L(robot): return dead_reckoning(robot)
"""


def test_a_report_takes_the_trials_of_the_manifests_own_code_alone_and_runs_none(tmp_path, capsys):
    plug_in, (one, two) = tmp_path / "p.py", (tmp_path / "one", tmp_path / "two")
    file = write_small(tmp_path, trials=1)
    for out, version in ((one, 1), (two, 2)):
        plug_in.write_text(PLUG_IN.format(version))
        assert sweep(file, out, "--with", f"{plug_in}:L") == 0
    before = (tmp_path / "ran").read_text()
    old = (one / "trials.jsonl").rename(one / "trials-old.jsonl")
    shutil.copytree(two, one, dirs_exist_ok=True)  # the old trials beside the new ones
    assert old.exists()
    capsys.readouterr()
    assert report(one) == 0
    assert tables(one) == tables(two)
    assert capsys.readouterr().err.count("is of other code, libraries or plug-ins") == 1
    assert (tmp_path / "ran").read_text() == before
    plug_in.unlink()
    assert report(one) == 0


PROJECT = {
    "mine.py": """
from localizers.template import MyLocalizer
class Mine(MyLocalizer):
    def reset(self, prior, plan, rng): return super().reset(prior, plan, rng)
    def update(self, *given): return super().update(*given)
""",
    "drivers.py": """
from benchmarks.agents import OpenLoop
class Own(OpenLoop):
    def plan_at_reset(self, info): return super().plan_at_reset(info)
    def act(self, belief, info): return super().act(belief, info)
""",
    "scans.py": """
from localizers import GaussianUniform
from localizers.models.scan import LidarScan
def made(floor_plan, lidar):
    return LidarScan(floor_plan=floor_plan, lidar=lidar, beam=GaussianUniform(sigma=100.0))
""",
    "hall.toml": 'base = "sharp"\nagent = "drivers.py"\n',
    "sweeps/all.toml": """
scenario = "../hall.toml"
localizers = ["mcl", "../mine.py"]
agent = "../drivers.py:Own"
assumed.scan.kind = "../scans.py:made"
trials = 1
params.particles = 15
""",
}


def written(folder):
    """Write a project with a plug-in of each kind; return its sweep file."""
    for name, text in PROJECT.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / "sweeps" / "all.toml"


def test_a_project_with_plug_ins_goes_on_where_it_was_moved_to(tmp_path, monkeypatch, capsys):
    there, here = tmp_path / "there", tmp_path / "here"
    assert sweep(written(there), there / "out") == 0, capsys.readouterr().err
    before = tables(there / "out")
    assert not [text for text in before.values() if str(there).encode() in text]
    held = json.loads((there / "out" / "manifest.json").read_text())["identity"]
    assert str(there) not in json.dumps(held)
    names = ("mine.py:Mine", "drivers.py:Own", "scans.py:made", "hall.toml")
    assert held["plug-ins"].keys() == {f"../{name}" for name in names}
    there.rename(here)
    ended = stored(here / "out")
    assert sweep(here / "sweeps" / "all.toml", here / "out") == 0, capsys.readouterr().err
    assert report(here / "out") == 0
    assert stored(here / "out") == ended
    assert tables(here / "out") == before
    (here / "mine.py").write_text(PROJECT["mine.py"] + "# edited\n")
    monkeypatch.chdir(tmp_path)
    assert exit_code("verify", here / "out", "--jobs", "1") == 0, capsys.readouterr().err
    assert sweep(here / "sweeps" / "all.toml", here / "out") == 0, capsys.readouterr().err
