"""``deqmcl speed`` with the least effort: every figure is measured once, by a call or so."""

import csv
from dataclasses import replace

import cv2
import pytest

from benchmarks.cli import main
from benchmarks.speed import command
from benchmarks.speed.figure import UnavailableError
from benchmarks.speed.timing import Effort

FILES = {"speed.csv", "scaling.csv", "speed.md", "speed.png", "scaling.png"}
LEAST = Effort(repeats=1, seconds=0.0)
TINY = command.Extent(figures=LEAST, scaling=LEAST, largest=100)
PEERS = {f.name for f in command.FIGURES if f.peer is not None}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("speed") / "new" / "folder"
    said = command.run_speed(out, extent=TINY, peers=False, command=["deqmcl", "speed"])
    return out, said


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def a_few(monkeypatch):
    """Leave the two quickest figures and one curve."""
    monkeypatch.setattr(command, "FIGURES", command.FIGURES[:2])
    monkeypatch.setattr(command, "QUICK", TINY)
    monkeypatch.setattr(command, "curves", lambda *, largest: CURVES(largest=largest)[2:3])


CURVES = command.curves


def test_all_files_are_written_whole_and_nothing_else(run):
    out, said = run
    assert {path.name for path in out.iterdir()} == FILES
    assert all(name in said for name in FILES)


def test_each_row_is_a_figure_with_ours_over_the_others(run):
    rows = rows_of(run[0] / "speed.csv")
    assert list(rows[0]) == ["figure", "ours", "other", "ratio"]
    names = [row["figure"] for row in rows]
    assert names == [f.name for f in command.FIGURES if f.name in names]
    assert {"rays_vs_numpy", "step1k_vs_numpy", "env_vs_cartpole", "deq_vs_map_step"} < set(names)
    for row in rows:
        ours, other, ratio = (float(row[name]) for name in ("ours", "other", "ratio"))
        assert min(ours, other) > 0
        assert ratio == pytest.approx(ours / other, rel=1e-4)


def test_what_was_not_measured_has_no_row_and_a_reason(run):
    out, said = run
    measured = {row["figure"] for row in rows_of(out / "speed.csv")}
    missing = {f.name for f in command.FIGURES} - measured
    assert missing >= PEERS
    assert "--peers" in said
    for text in (said, (out / "speed.md").read_text()):
        reasons = [line for line in text.splitlines() if line.startswith("No row: ")]
        assert {name for name in missing if any(name in line for line in reasons)} == missing
        assert not any(name + "," in line for name in measured for line in reasons)


def test_the_curves_cover_segments_particles_beams_and_lags(run):
    points = rows_of(run[0] / "scaling.csv")
    values = {}
    for point in points:
        assert float(point["result"]) > 0
        assert point["unit"] in {"rays/s", "µs/step"}
        values.setdefault((point["varied"], point["who"]), []).append(int(point["value"]))
    assert values == {
        ("segments", "PolygonMap.ranges"): [8, 16, 32, 64, 128, 256, 512],
        ("particles", "mcl"): [100],
        ("particles", "NumPy"): [100],
        ("beams", "mcl"): [1, 2, 4, 8, 16, 32, 64],
        ("lag", "deq-mcl"): [0, 5, 10, 20, 40, 80],
    }


def test_the_full_run_goes_to_a_million_particles_and_the_quick_one_does_not():
    assert command.FULL.largest == 1_000_000
    assert command.QUICK.largest < 1_000_000
    (by_particles,) = [
        c for c in CURVES(largest=1_000_000) if (c.varied, c.who) == ("particles", "mcl")
    ]
    assert list(by_particles.values) == [100, 1_000, 10_000, 100_000, 1_000_000]


def test_the_readable_table_names_command_figures_targets_and_versions(run):
    text = (run[0] / "speed.md").read_text()
    assert "`deqmcl speed`" in text
    for words in ("| rays_vs_numpy ", "≥ 8", "≤ 1.5", "rays/s", "µs/step", "numpy ", "numba "):
        assert words in text


@pytest.mark.parametrize("name", ["speed.png", "scaling.png"])
def test_pictures_can_be_opened(run, name):
    height, width, _ = cv2.imread(str(run[0] / name)).shape
    assert min(height, width) > 300


def test_the_command_measures_and_prints(monkeypatch, tmp_path, capsys):
    a_few(monkeypatch)
    assert main(["speed", "--quick", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "rays_vs_numpy" in said
    assert "`deqmcl speed --quick --out" in (tmp_path / "speed.md").read_text()


def test_a_stop_while_the_curves_are_measured_leaves_the_old_files_as_they_were(
    monkeypatch, tmp_path
):
    def stop(*_):
        raise KeyboardInterrupt

    a_few(monkeypatch)
    monkeypatch.setattr(command, "scaled", stop)
    for name in FILES:
        (tmp_path / name).write_text("old")
    with pytest.raises(KeyboardInterrupt):
        command.run_speed(tmp_path, extent=TINY, peers=False, command=["deqmcl", "speed"])
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys(
        FILES, "old"
    )


def test_the_command_in_the_readable_table_is_one_that_a_shell_reads_back(monkeypatch, tmp_path):
    a_few(monkeypatch)
    out = tmp_path / "a b"
    assert main(["speed", "--quick", "--out", str(out)]) == 0
    assert f"`deqmcl speed --quick --out '{out}'`" in (out / "speed.md").read_text()


def test_a_peer_that_is_not_installed_has_no_row(monkeypatch, tmp_path, capsys):
    def missing():
        raise UnavailableError("it is not installed")

    a_few(monkeypatch)
    first, second = command.FIGURES
    monkeypatch.setattr(command, "FIGURES", (first, replace(second, peer="p", sides=missing)))
    assert main(["speed", "--quick", "--peers", "--out", str(tmp_path)]) == 0
    assert "No row: rays_vs_numpy_slabs: it is not installed." in capsys.readouterr().out
    assert [row["figure"] for row in rows_of(tmp_path / "speed.csv")] == ["rays_vs_numpy"]


def test_without_matplotlib_there_are_no_pictures_but_all_else(monkeypatch, tmp_path, capsys):
    a_few(monkeypatch)
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    assert main(["speed", "--quick", "--out", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {f for f in FILES if f[-3:] != "png"}
    assert "deqmcl-gym[plots]" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "named"),
    [(["--quik"], "did you mean --quick?"), (["now"], "'now'"), (["--out"], "--out")],
)
def test_an_unknown_argument_is_refused_in_one_sentence(capsys, arguments, named):
    with pytest.raises(SystemExit) as end:
        main(["speed", *arguments])
    err = capsys.readouterr().err
    assert end.value.code == 2
    assert named in err
    assert err.count("\n") == 1


def test_help_names_every_flag(capsys):
    with pytest.raises(SystemExit) as end:
        main(["speed", "--help"])
    assert end.value.code == 0
    said = capsys.readouterr().out
    assert all(flag in said for flag in ("--quick", "--peers", "--out", "--debug"))


def test_an_output_folder_that_is_a_file_is_refused_before_anything_is_measured(
    monkeypatch, tmp_path, capsys
):
    monkeypatch.setattr(command, "FIGURES", None)  # would raise
    file = tmp_path / "file"
    file.write_text("mine")
    for out in (file, file / "below"):
        assert main(["speed", "--quick", "--out", str(out)]) == 2
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        assert str(out) in err
    assert file.read_text() == "mine"
