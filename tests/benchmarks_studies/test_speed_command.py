"""``deqmcl speed`` with the least effort: every figure is measured once, by a call or so."""

from dataclasses import replace

import cv2
import pytest
from deqmcl_command import exit_code, files, lines

from benchmarks.studies.speed import command
from benchmarks.studies.speed.figure import Effort, Job, Published, Side

NAMED = {"speed.csv", "scaling.csv", "speed.md", "scaling.png"}
FILES = {*NAMED}
LEAST = Effort(repeats=1, seconds=0.0)
TINY = command.Extent(figures=LEAST, scaling=LEAST, largest=100)
CURVES = command.steps.curves(largest=100)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("speed") / "new" / "folder"
    return out, measured(out)


@pytest.fixture
def few(monkeypatch):
    """Two quick figures, one of them a peer's, which is not installed, and one curve."""

    def missing():
        raise ModuleNotFoundError("No module named 'theirs'")

    job = Side("they", lambda: Job(int))
    first = replace(command.FIGURES[0], name="first", ours=job, other=job)
    monkeypatch.setattr(command, "FIGURES", (first,))
    peer = replace(first, name="peer", other=Side("theirs", missing))
    monkeypatch.setattr(command, "PEERS", (peer,))
    monkeypatch.setattr(command, "QUICK", TINY)
    monkeypatch.setattr(command.steps, "curves", lambda *, largest: CURVES[3:4])


def measured(out):
    return command.run_speed(out, extent=TINY, peers=False, command=["deqmcl", "speed"])


def test_all_files_are_written_and_named_and_nothing_else(run):
    out, said = run
    assert {*files(out)} == FILES
    assert all(name in said for name in NAMED)
    height, width, _ = cv2.imread(str(out / "scaling.png")).shape
    assert min(height, width) > 300


def test_each_row_is_a_figure_with_ours_over_the_others(run):
    rows = lines(run[0], "speed.csv")
    assert [row["figure"] for row in rows] == [figure.name for figure in command.FIGURES]
    for figure, row in zip(command.FIGURES, rows, strict=True):
        ours, other = float(row["ours"]), float(row["other"])
        assert min(ours, other) > 0
        if isinstance(figure.other, Published):
            assert row["ratio"] == ""
        else:
            assert float(row["ratio"]) == pytest.approx(ours / other, rel=1e-4)


def test_each_point_of_each_curve_is_a_row(run):
    points = lines(run[0], "scaling.csv")
    assert all(float(point["result"]) > 0 for point in points)
    seen = [(point["task"], point["who"], int(point["value"])) for point in points]
    assert seen == [(c.what, c.who, value) for c in CURVES for value in c.values]


def test_a_missed_target_is_marked_in_what_is_printed_and_in_the_page(monkeypatch, few, tmp_path):
    (figure,) = command.FIGURES
    ends = [replace(figure, name=n, target=t) for n, t in (("far", 1e9), ("near", 1e-9))]
    monkeypatch.setattr(command, "FIGURES", ends)
    said = measured(tmp_path)
    for text in (said, (tmp_path / "speed.md").read_text()):
        rows = [line.strip("| ") for line in text.splitlines()]
        far, near = (next(row for row in rows if row.startswith(n)) for n in ("far", "near"))
        assert far.endswith("missed")
        assert near.endswith("yes")


def test_peers_have_a_reason_instead_of_a_row(few, tmp_path, capsys):
    for flags, reason in (([], "only with --peers"), (["--peers"], "No module named 'theirs'")):
        assert exit_code("speed", "--quick", *flags, "--out", tmp_path) == 0
        assert [row["figure"] for row in lines(tmp_path, "speed.csv")] == ["first"]
        for text in (capsys.readouterr().out, (tmp_path / "speed.md").read_text()):
            (why,) = (line for line in text.splitlines() if line.startswith("No row: peer: "))
            assert reason in why


def test_a_stop_while_the_curves_are_measured_leaves_the_old_files_as_they_were(
    monkeypatch, few, tmp_path
):
    def stop(*_):
        raise KeyboardInterrupt

    measured(tmp_path)
    old = files(tmp_path)
    assert {*old} == FILES
    monkeypatch.setattr(command.steps, "scaled", stop)
    with pytest.raises(KeyboardInterrupt):
        measured(tmp_path)
    assert files(tmp_path) == old


def test_the_page_names_its_versions_and_a_command_that_a_shell_reads_back(few, tmp_path):
    out = tmp_path / "a b"
    assert exit_code("speed", "--quick", "--out", out) == 0
    page = (out / "speed.md").read_text()
    for words in (f"`deqmcl speed --quick --out '{out}'`", "rays/s", "numpy ", "numba "):
        assert words in page


def test_without_matplotlib_there_is_no_picture_but_all_else(monkeypatch, few, tmp_path, capsys):
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    assert exit_code("speed", "--quick", "--out", tmp_path) == 0
    assert {*files(tmp_path)} == FILES - {"scaling.png"}
    assert "deqmcl-gym[plots]" in capsys.readouterr().out
    assert ".png" not in (tmp_path / "speed.md").read_text()
