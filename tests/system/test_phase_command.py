"""``deqmcl phase``: place fields over the theta phase."""

import pytest
from deqmcl_command import DEQMCL, exit_code, files, lines, process
from sweep_command import broken

import localizers

FEW = ("--particles", "20", "--lag", "5", "--seed", "3")
WRITTEN = {"cycles.csv", "fields.csv", "phase.md", "phase.png"}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    home = tmp_path_factory.mktemp("phase")
    return process(DEQMCL, "phase", *FEW, "--out", "new/out", cwd=home), home / "new/out"


def test_it_leaves_a_figure_its_data_and_a_page_and_nothing_else(drawn):
    done, out = drawn
    assert (done.returncode, done.stderr) == (0, "")
    assert set(files(out)) == WRITTEN
    page = (out / "phase.md").read_text()
    assert "\ndeqmcl phase --particles 20 --lag 5 --seed 3 --out new/out\n" in page
    for title in ("perfect queue", "mcl-smoother", "deq-mcl-fresh"):
        assert title in page
        assert title in done.stdout


def test_the_data_has_a_row_for_every_state_that_a_queue_holds(drawn):
    rows = lines(drawn[1], "cycles.csv")
    offsets = {"perfect queue": range(-5, 6), "mcl": range(1), "mcl-smoother": range(-5, 1)}
    offsets |= dict.fromkeys(("deq-mcl", "deq-mcl-fresh"), range(-5, 6))
    expected = [
        (method, t, k, t + k)
        for method, held in offsets.items()
        for t in range(205)
        for k in held
        if 0 <= t + k <= 204
    ]
    named = ("step", "offset", "state")
    assert [(line["method"], *(int(line[n]) for n in named)) for line in rows] == expected
    for line in rows:
        mass = [float(line[f"field_{i}"]) for i in range(1, 13)]
        assert min(mass) >= 0
        assert sum(mass) <= 1 + 12 * 5e-5  # four digits of each
        if line["method"] == "perfect queue":
            assert float(line["error_px"]) == float(line["spread_px"]) == 0


def test_fields_methods_scenario_and_lag_are_those_asked_for(tmp_path):
    arguments = ("--localizers", "dead-reckoning", "--scenario", "sharp", "--lag", "30")
    assert exit_code("phase", *arguments, "--fields", "7", "--out", tmp_path) == 0
    assert [line["field"] for line in lines(tmp_path, "fields.csv")] == [*map(str, range(1, 8))]
    rows = lines(tmp_path, "cycles.csv")
    assert [name for name in rows[0] if "field" in name] == [f"field_{i}" for i in range(1, 8)]
    assert {line["method"] for line in rows} == {"perfect queue", "dead-reckoning"}
    assert {int(line["offset"]) for line in rows} == {*range(-30, 31)}
    assert "scenario sharp, N = 1000, L = 30, seed 0" in (tmp_path / "phase.md").read_text()


def test_the_same_command_writes_the_same_bytes(drawn, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert exit_code("phase", *FEW, "--out", "new/out") == 0
    assert files(tmp_path / "new/out") == files(drawn[1])


def test_a_queue_of_the_present_alone_is_drawn_too(tmp_path):
    arguments = ("--localizers", "deq-mcl", "--particles", "5", "--lag", "0")
    assert exit_code("phase", *arguments, "--out", tmp_path) == 0
    assert set(files(tmp_path)) == WRITTEN


@localizers.registered("broken", broken)
def test_a_lap_that_fails_leaves_nothing_written(tmp_path, capsys):
    assert exit_code("phase", "--localizers", "mcl,broken", *FEW, "--out", tmp_path) == 3
    assert capsys.readouterr().err == "deqmcl: ArithmeticError: broken (--debug shows where)\n"
    assert files(tmp_path) == {}
