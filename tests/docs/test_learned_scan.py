"""The learned scan model of docs/examples: a density, as it was trained, and in use."""

import runpy
import sys
from dataclasses import replace

import numpy as np
import pytest
from deqmcl_command import python
from refusals import refused
from test_links import ROOT
from training_data import recorded

import localizers
from benchmarks.checks import check
from benchmarks.setup.names import scenario
from localizers.registry import ScanPlugIn

FOLDER = ROOT / "docs" / "examples" / "learned_scan"
MODEL = f"{FOLDER}/learned_scan.py:LearnedScan"
REACH, BEAMS = 12.0, 16


@pytest.fixture(scope="module")
def code():
    sys.path.insert(0, str(FOLDER))
    yield runpy.run_path(str(FOLDER / "learned_scan.py"))
    sys.path.remove(str(FOLDER))


@pytest.fixture(scope="module")
def net(code):
    return code["ScanNet"]()


def pairs(rng, count):
    """Scans and expected ranges: some fit, some are short or long, or at an end of the range."""
    expected = rng.uniform(0.3, 14.0, (count, BEAMS))
    measured = np.clip(expected + rng.normal(0, 0.5, expected.shape), 0, REACH)
    others = rng.random(expected.shape) < 0.3
    measured[others] = rng.uniform(0, REACH, int(others.sum()))
    measured[rng.random(expected.shape) < 0.05] = REACH
    measured[rng.random(expected.shape) < 0.02] = 0.0
    return measured, expected


@pytest.mark.parametrize("beam", [0, 15])
def test_the_density_of_a_beam_and_the_masses_of_the_ends_add_up_to_1(net, beam):
    measured, expected = pairs(np.random.default_rng(beam), 20)
    inside = (np.arange(6000) + 0.5) * REACH / 6000
    for scan, wall in zip(measured, expected, strict=True):
        scans = np.tile(scan, (inside.size + 2, 1))
        scans[:, beam] = [*inside, 0.0, REACH]
        found = np.exp(net.log_density(scans, np.tile(wall, (len(scans), 1)))[:, beam])
        total = found[:-2].sum() * REACH / 6000 + found[-2:].sum()
        assert total == pytest.approx(1.0, abs=2e-3)


def test_a_beam_does_not_depend_on_those_after_it(net):
    rng = np.random.default_rng(0)
    measured, expected = pairs(rng, 50)
    before = net.log_density(measured, expected)
    for beam in range(BEAMS - 1):
        other = measured.copy()
        other[:, beam + 1 :] = rng.uniform(0, REACH, (50, BEAMS - 1 - beam))
        found = net.log_density(other, expected)
        assert np.allclose(found[:, : beam + 1], before[:, : beam + 1], rtol=0, atol=1e-5)
        assert not np.allclose(found[:, beam + 1], before[:, beam + 1], rtol=0, atol=0.1)


def test_it_keeps_the_laws_of_scan_models():
    assert check("scan models", MODEL).passed


def test_a_map_in_pixels_or_another_lidar_is_refused():
    sharp, lost = scenario("sharp"), scenario("lost")
    for setup in (sharp, lost.changed({"lidar.beams": 8})):
        robot = replace(setup.robot_model(setup.room()), scan=ScanPlugIn(kind=MODEL))
        with refused("learned scan model"):
            robot.scan_model()


def test_in_unseen_buildings_it_predicts_scans_better_where_the_map_is_wrong_and_only_there(net):
    beam = localizers.CensoredGaussianUniform(sigma=0.5)
    gains = {}
    for world in ("lost", str(FOLDER / "high.toml")):
        data = recorded((3000, 3040), 30, rooms=24, crop=2, scenario=world)
        seen, wall = data["scan"].reshape(-1, BEAMS).astype(float), data["expected"]
        usual = [
            beam.log_likelihood(z, e[None], REACH)[0]
            for z, e in zip(seen, wall.reshape(-1, BEAMS), strict=True)
        ]
        gains[world] = net.log_density(seen, wall.reshape(-1, BEAMS)).sum(axis=1).mean() - np.mean(
            usual
        )
    right, wrong = gains.values()  # nats a scan
    assert -1.0 < right < 0.0
    assert wrong > 2.0


def test_training_writes_what_the_model_reads(tmp_path):
    pytest.importorskip("torch")
    data = recorded((40, 42), 4, rooms=2, crop=2, scenario="lost")
    np.savez(tmp_path / "data.npz", **data)
    out, files = (
        tmp_path / "new.npz",
        ("--data", tmp_path / "data.npz", "--unseen", tmp_path / "data.npz"),
    )
    said = python(FOLDER / "train_scan_model.py", *files, "--epochs", 1, "--out", out)
    assert said.count("beam model") == said.count("learned") == 2
    with np.load(out) as new, np.load(FOLDER / "learned_scan.npz") as shipped:
        assert {n: new[n].shape for n in new} == {n: shipped[n].shape for n in shipped}
