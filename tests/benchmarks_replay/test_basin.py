"""The suite ``basin``: starts that are wrong, and how many runs are localized from there."""

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from deqmcl_command import exit_code, lines
from report_cases import trial_of

from benchmarks.report.runs import starts_table
from benchmarks.setup.names import scenario
from benchmarks.sweeps.results import results_in
from benchmarks.trials.stage import Stage
from localizers import GaussianPrior

RIGHT_ANGLE = math.pi / 2
WORLD = """world = { log = "lap.csv", map = "hall.yaml", reference = "lap.tum", segment = 2.0 }
"""
FEW = f"""base = "basin"
trials = 2
{WORLD}
[[vary]]
assumed.prior.distance = [0.0, 0.8, 1.2]

[[vary]]
assumed.prior.angle = [0.0, {RIGHT_ANGLE}]
"""


def swept(text):
    Path("starts.toml").write_text(text, encoding="utf-8")
    return exit_code("sweep", "starts.toml", "--jobs", "1", "--out", "out")


def begun(distance, angle, number=0, localizer="mcl"):
    assumed = {"prior.kind": "displaced", "prior.distance": distance, "prior.angle": angle}
    how = {"scenario": "driving-blind", "assumed": assumed, "lag": 0, "seed": 3}
    trial = trial_of(localizer, number, **how)
    stage = Stage.of(trial)
    stage.env.reset(seed=trial.world_seed)
    return stage


def test_a_displaced_mean_is_off_by_the_distance_and_the_angle_and_stands_in_free_space():
    directions, sides = [], []
    for number in range(8):
        near, far = begun(0.5, 0.7, number), begun(2.0, 0.7, number)
        right = np.array(near.room.expected_start)
        assert begun(0.0, 0.0, number).prior().mean == pytest.approx(tuple(right), abs=1e-12)
        off = np.array([stage.prior().mean for stage in (near, far)]) - right
        np.testing.assert_allclose(np.hypot(*off[:, :2].T), [0.5, 2.0], rtol=1e-12)
        np.testing.assert_allclose(np.abs(off[:, 2]), 0.7, rtol=1e-12)
        for stage in (near, far):
            at = np.array([stage.prior().mean])
            assert stage.room.floor_plan.free(at, stage.room.radius).all()
        assert stage.prior() == begun(2.0, 0.7, number, localizer="deq-mcl").prior()
        directions.append(math.atan2(off[0, 1], off[0, 0]))
        sides.append(off[0, 2] > 0)
    assert len({round(one, 6) for one in directions}) == 8
    assert {True, False} == set(sides)  # all on one side: 1 in 128, and the seed is fixed


def test_a_displaced_prior_keeps_its_spread_and_is_scored_as_of_the_lost():
    stage = begun(1.0, 0.5)
    base = scenario("driving-blind").prior
    spread = {"sd_position": base.sd_position, "sd_heading": base.sd_heading}
    expected = GaussianPrior(mean=(0, 0, 0), **spread)
    assert replace(stage.prior(), mean=(0, 0, 0)) == expected
    assert "lost" in [group.name for group in stage.groups]


def test_dead_reckoning_is_localized_just_where_its_start_is_near_enough(recorded):
    exact = "{ kind = 'displaced', sd_position = 0.0, sd_heading = 0.0 }"
    top = f"localizers = ['dead-reckoning', 'mcl']\nbaseline = 'mcl'\nassumed.prior = {exact}\n"
    assert swept(top + FEW) == 0
    rows = lines(recorded / "out", "basin.csv")
    stored = starts_table(results_in("out").records).astype(object).astype(str)
    assert rows == stored.to_dict("records")
    own = [row for row in rows if row["localizer"] == "dead-reckoning"]
    shares = {(row["distance_m"], row["angle_deg"]): row["share"] for row in own}
    # odometry drifts by less than 0.1 m in 2 m: an error of the start stays what it is
    starts = itertools.product(("0.0", "0.8", "1.2"), ("0.0", "90.0"))
    assert shares == {(d, a): str(float(d != "1.2" and a == "0.0")) for d, a in starts}
    (chart,) = (recorded / "out/images").glob("shares*.svg")
    assert "100 %" in chart.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('base = "basin"\n', ["no log", "world.log"]),
        (FEW.replace("1.2]", "90.0]"), ["prior.distance", "90", "nothing is free"]),
    ],
)
def test_what_cannot_be_asked_is_refused_and_nothing_is_written(recorded, text, named, capsys):
    assert swept(text) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert [word for word in named if word not in said] == [], said
    assert not (recorded / "out").exists()
