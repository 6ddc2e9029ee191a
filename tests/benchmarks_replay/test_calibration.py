"""What is fitted to part of a log: the power of scans, and what covariance is published.

And what follows from that power: how much a touch of the map's walls may cost.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.robots import replay_of
from benchmarks.robots.calibration import PART, judged_after_part, with_fitted_power
from benchmarks.robots.replaying import methods_of, replay_sweep
from benchmarks.trials.stage import Stage, attempt, key_of
from deqmcl_gym import logs
from deqmcl_gym.logs.motion import composed, dead_reckoned, increments_of
from deqmcl_gym.maps import GridMap

EVERY = {"world.every": "0.1m,5deg"}
STRAY = [(32, 100)]  # a cell on the robot's way, 5 cm wide
SPECKLED = [(row, column) for row in range(13, 60, 6) for column in range(70, 131, 12)]


def hall() -> GridMap:
    cells = np.full((160, 220), -1, np.int8)  # 11 m x 8 m; unknown beyond the walls
    cells[10:150, 10:210] = 0
    cells[[10, 149], 10:210] = cells[10:150, [10, 209]] = 100
    cells[60:90, 80:130] = cells[11:25, 60:70] = cells[130:149, 150:165] = 100
    return GridMap(occupancy=cells, resolution=0.05)


def recorded(seed: int, laps: int = 1) -> logs.Log:
    """Laps of 23 m on arcs and with turns on the spot, a lidar ahead of the wheels."""
    rng, turns = np.random.default_rng(seed), [(0.0, 0.0, math.pi / 20)] * 10
    lap = []
    for length in (7.0, 4.5, 7.0, 4.5):
        bends = rng.uniform(-0.02, 0.02, round(length / 0.1))
        lap += [(0.1, 0.0, bend) for bend in bends - bends.mean()] + turns
    start = (1.5, 1.6, 0.0)
    truth = dead_reckoned(np.array(lap * laps), start)
    moved = increments_of(truth)
    moved *= 1 + rng.normal(0, 0.1, moved.shape)
    angles = tuple(np.linspace(-1.5, 1.5, 60))
    scanner = logs.Scanner(angles=angles, max_range=20.0, mounting=(0.2, 0.05))
    ranges = hall().ranges(composed(truth, np.array([0.2, 0.05, 0.0])), scanner.bearings)
    ranges = ranges + rng.normal(0, 0.03, ranges.shape)
    return logs.Log(scanner, np.arange(len(truth)) * 0.1, dead_reckoned(moved), ranges, truth)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A log of 2 laps whose map is 3 % too large: all beams are too short together."""
    folder = tmp_path_factory.mktemp("hall")
    hall().save(folder / "hall.yaml")
    log = recorded(0, laps=2)
    logs.write(replace(log, ranges=log.ranges / 1.03), folder / "log.npz")
    return folder


@pytest.fixture(scope="module")
def replay(folder):
    return replay_of(folder / "log.npz", folder / "hall.yaml", settings=EVERY)


def published(replay):
    """The scores of a run of mcl, of the records after those fitted to."""
    own = {"mcl": {"particles": 1000}}
    sweep = replay_sweep(replay, methods_of(["mcl"], None, own), 1, 1)
    (trial,) = sweep.distinct()
    return attempt(trial, key_of(trial)).record.track.scores


def test_a_fitted_power_is_as_exact_as_any_and_what_is_published_is_honest_on_the_rest(replay):
    judged = judged_after_part(replay)
    fitted = with_fitted_power(judged)
    assert judged.scenario.judged == fitted.scenario.judged == math.ceil(PART * len(replay.log))
    assert with_fitted_power(judged) == fitted  # whenever it is made
    assert fitted.assumed == replay.assumed | {"scan.power": fitted.scenario.scan.power}
    believed, sharp, best = map(published, (replay, judged, fitted))
    assert believed["coverage_95"] < 0.6
    assert believed["calibration_scale"] is None
    for own in (sharp, best):
        assert 0.85 <= own["coverage_95"] <= 1.0
        assert own["log_score"] < believed["log_score"]
        assert own["calibration_scale"] > 0
    assert best["log_score"] < sharp["log_score"] + 0.1
    assert best["position_p95"] < 1.1 * sharp["position_p95"]


def test_without_enough_of_a_reference_the_power_stays(replay, folder):
    for part in ({"length": 250}, {"start": 400}):
        few = replace(replay, world=replay.world | part)
        kept = with_fitted_power(judged_after_part(few))
        assert replace(kept, power="") == few
        assert kept.facts[2].startswith("The power is 1: not fitted")
    log = logs.read(folder / "log.npz")
    logs.write(replace(log, reference=None), folder / "blind.npz")
    told = {"settings": EVERY, "start": "1.5,1.6,0"}
    blind = replay_of(folder / "blind.npz", folder / "hall.yaml", **told)
    assert replace(with_fitted_power(blind), power="") == blind
    assert judged_after_part(blind) == blind


def largest_error(tmp_path, cells, name, power, **params):
    """Of a run on a hall with these cells occupied on the map, but not in the hall."""
    occupancy = hall().occupancy.copy()
    occupancy[tuple(np.transpose(cells))] = 100
    GridMap(occupancy=occupancy, resolution=0.05).save(tmp_path / "hall.yaml")
    logs.write(recorded(0), tmp_path / "log.npz")
    told = EVERY | {"assumed.scan.power": power}
    replay = replay_of(tmp_path / "log.npz", tmp_path / "hall.yaml", settings=told)
    own = {name: params}
    sweep = replay_sweep(replay, methods_of([name], 1000, own), 1, 1)
    (trial,) = sweep.distinct()
    stage = Stage.of(trial)
    kept = stage.collector()
    for moment in stage.moments():
        kept.see(moment)
    return kept.track.errors.translation.max()


@pytest.mark.parametrize(  # powers are of the two real logs
    ("cells", "off", "power"), [(STRAY, 0.2, 0.05), (SPECKLED, 1.0, 0.02)]
)
def test_cells_not_there_cost_the_papers_charge_but_not_the_default(tmp_path, cells, off, power):
    blind, default, paper = (
        largest_error(tmp_path, cells, name, power, **params)
        for name, params in (("mcl", {}), ("mcl-map", {}), ("mcl-map", {"beta": 10.0}))
    )
    assert default <= 1.2 * blind
    assert blind < off < paper
