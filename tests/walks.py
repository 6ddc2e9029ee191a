"""How much there is to hold: files that a run enters, calls of a trial, lines of source and tests.

``python tests/walks.py`` prints the table; ``system/test_walks.py`` holds it below the limits. All
threads and processes of a run count, calls made while a module is being imported do not.
"""

import contextlib
import graphlib
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = "deqmcl_gym", "localizers", "benchmarks"
OURS = tuple(f"{ROOT / package}{os.sep}" for package in PACKAGES)

# All limits fall with the code.
LIMITS = {  # the most files that each may enter
    "deqmcl paper": 80,
    "a sweep cell": 82,
    "a trial of mcl": 44,
    "a trial of deq-mcl": 42,
    "update of mcl": 12,
    "env.step": 8,
}
MOST_CALLS = 16_100  # of functions of ours, in a trial of mcl
MOST_FILES = 150  # of source
MOST_LINES = {"source": 36_500, "tests": 24_900}

COMMANDS = {"deqmcl paper": "paper --trials 1 --jobs 1 --localizers mcl --out {out}"}
COMMANDS["a sweep cell"] = "sweep {cell} --jobs 1 --out {out}"
CELL = """
title = "a cell"
scenario = "guided"
localizers = ["deq-mcl"]
trials = 1
"""
EVERYWHERE = """
import sys
sys.path.insert(0, {tests!r})
import walks
sys.path.remove({tests!r})
walks.follow({log!r})
"""


class _Hook:
    """A profile hook that counts calls of ours, and hands on each file when one is its first."""

    def __init__(self, seen: Callable[[str], object]) -> None:
        self.calls = 0
        self._seen, self._files = seen, set()
        self._imports = threading.local()

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        depth = getattr(self._imports, "depth", 0)
        if code.co_name == "<module>" and frame.f_globals.get("__name__") != "__main__":
            self._imports.depth = max(0, depth + (event == "call") - (event == "return"))
        elif event == "call" and depth == 0:
            file = code.co_filename
            if not file.startswith(OURS):
                return
            self.calls += 1
            if file not in self._files:
                self._files.add(file)
                self._seen(os.path.relpath(file, ROOT))


def follow(log: str) -> None:
    """From here on write each file entered to ``log``, in forked processes too."""
    line = os.open(log, os.O_WRONLY | os.O_APPEND)
    hook = _Hook(lambda file: os.write(line, f"{file}\n".encode()))
    threading.setprofile(hook)
    sys.setprofile(hook)


@dataclass
class Walk:
    """What was entered: files, and how many calls of our functions there were."""

    files: set[str] = field(default_factory=set)
    calls: int = 0


@contextlib.contextmanager
def followed() -> Iterator[Walk]:
    """Yield what this thread enters within the context."""
    walk = Walk()
    hook = _Hook(walk.files.add)
    sys.setprofile(hook)
    try:
        yield walk
    finally:
        sys.setprofile(None)
        walk.calls = hook.calls


def of_command(name: str) -> set[str]:
    """Return the files that a command of ``COMMANDS`` enters, in all its processes."""
    with tempfile.TemporaryDirectory() as folder:
        log, cell, site = (Path(folder, part) for part in ("log", "cell.toml", "site"))
        log.touch()
        cell.write_text(CELL)
        site.mkdir()  # what Python imports when it starts
        text = EVERYWHERE.format(tests=str(ROOT / "tests"), log=str(log))
        (site / "sitecustomize.py").write_text(text)
        words = COMMANDS[name].format(cell=cell, out=Path(folder, "out")).split()
        path = os.pathsep.join([str(site), str(ROOT)])
        command = [sys.executable, "-m", "benchmarks", *words]
        env = os.environ | {"PYTHONPATH": path}
        subprocess.run(command, env=env, check=True, capture_output=True)
        return set(log.read_text().split())


def of_a_trial(method: str) -> Walk:
    """Return the files that a trial enters, without a worker and a store, and its calls.

    The calls are those of a second trial, in a world that is driven already, as most of a sweep.
    """
    from benchmarks.sweeps.sweepfile import sweep_named
    from benchmarks.trials.stage import attempt, key_of

    with tempfile.TemporaryDirectory() as folder:
        cell = Path(folder, "cell.toml")
        cell.write_text(CELL.replace("guided", "paper").replace("deq-mcl", method))
        sweep = sweep_named(str(cell))
    (trial,) = sweep.distinct()
    key = key_of(trial)
    with followed() as first:
        assert attempt(trial, key).record
    with followed() as second:
        assert attempt(trial, key).record
    return Walk(first.files, second.calls)


def of_a_step() -> tuple[set[str], set[str]]:
    """Return the files that one ``env.step`` and one ``update`` of MCL enter, not the first."""
    import gymnasium as gym
    import numpy as np

    import deqmcl_gym  # noqa: F401 - registers the environment
    import localizers

    env = gym.make("deqmcl_gym/Room-v0").unwrapped
    _, info = env.reset(seed=0)
    plan = info["planned_actions"]
    robot = localizers.RobotModel(floor_plan=env.floor_plan, lidar=env.lidar)
    mcl = localizers.make("mcl", robot)
    mcl.reset(localizers.UniformPrior(floor_plan=env.floor_plan), plan, np.random.default_rng(0))
    for k in range(4):
        with followed() as stepping:
            ranges = env.step(plan[k])[0]
        with followed() as updating:
            mcl.update(ranges, plan[k], plan[k + 1 :])
    return stepping.files, updating.files


def walks() -> dict[str, set[str]]:
    stepping, updating = of_a_step()
    files = {name: of_command(name) for name in COMMANDS}
    files |= {f"a trial of {method}": of_a_trial(method).files for method in ("mcl", "deq-mcl")}
    return files | {"update of mcl": updating, "env.step": stepping}


def source() -> list[Path]:
    return sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def lines() -> dict[str, int]:
    files = {"source": source(), "tests": (ROOT / "tests").rglob("*.py")}
    lengths = {name: [path.read_bytes().count(b"\n") for path in files[name]] for name in files}
    return {name: sum(own) for name, own in lengths.items()}


def circle() -> list[str]:
    """Return the modules of an import circle, lazy imports included; empty if there is none."""
    import grimp

    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


if __name__ == "__main__":
    sys.path[0] = str(ROOT)  # not tests/, which has folders of the same names
    for name, files in walks().items():
        print(f"{name:20}{len(files):5} files of at most {LIMITS[name]}")
        if sys.argv[1:] == ["--files"]:
            print(*sorted(files), sep="\n")
    print(f"{'a trial of mcl':20}{of_a_trial('mcl').calls:5} calls of at most {MOST_CALLS}")
    print(f"{'source':20}{len(source()):5} files of at most {MOST_FILES}")
    for name, count in lines().items():
        print(f"{name:20}{count:5} lines of at most {MOST_LINES[name]}")
    print(f"import circle: {' → '.join(circle()) or 'none'}")
