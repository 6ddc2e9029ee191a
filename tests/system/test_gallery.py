"""Figures are drawn again when anything they were drawn from has changed, and only then."""

import shutil
from dataclasses import replace

import pytest
from deqmcl_command import exit_code, files

from benchmarks.pictures import gallery
from benchmarks.pictures.gallery import Gallery
from benchmarks.sweeps.suites import paper_suite
from benchmarks.trials import attempt, provenance

FEW = ("paper", "--trials", "1", "--particles", "10", "--jobs", "1")
(TRIAL,) = paper_suite(localizers=["deq-mcl"], trials=1, particles=10)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gallery")
    Gallery([TRIAL], folder).draw()
    return folder


@pytest.fixture
def copy(drawn, tmp_path):
    return shutil.copytree(drawn, tmp_path / "figures")


def test_figures_just_drawn_are_current_and_listed(drawn):
    shown = Gallery([TRIAL], drawn)
    assert shown.current()
    names = {path.name for path in shown.files}
    assert names == {"fig4_deq-mcl.png", "fig5_step150.png", "fig5_step170.png", "lap.webp"}
    assert set(files(drawn)) == names | {gallery.RECORD}


def test_a_folder_that_is_missing_holds_no_current_figures_unless_none_are_shown(tmp_path):
    assert not Gallery([TRIAL], tmp_path / "none").current()
    assert Gallery([], tmp_path / "none").current()


@pytest.mark.parametrize(
    "change", [{"seed": 1}, {"lag": 10}, {"scenario": "sharp"}, {"params": (("particles", 11),)}]
)
def test_figures_of_another_trial_are_not_current(drawn, change):
    assert not Gallery([replace(TRIAL, **change)], drawn).current()


def test_figures_of_more_or_fewer_methods_are_not_current(drawn):
    assert not Gallery([TRIAL, replace(TRIAL, localizer="mcl")], drawn).current()
    assert not Gallery([], drawn).current()


@pytest.mark.parametrize("package", ["deqmcl_gym", "localizers", "benchmarks"])
def test_figures_of_other_code_are_not_current(drawn, monkeypatch, tmp_path, package):
    folder = provenance._folder
    changed = shutil.copytree(folder(package), tmp_path / package)
    (changed / "__init__.py").write_text('"""Changed."""\n')
    monkeypatch.setattr(provenance, "_folder", lambda p: changed if p == package else folder(p))
    for cached in (provenance.provenance, provenance.code_digest):
        monkeypatch.setattr(provenance, cached.__name__, cached.__wrapped__)
    monkeypatch.setattr("benchmarks.trials.plugins.provenance", provenance.provenance)
    assert not Gallery([TRIAL], drawn).current()


def test_figures_by_another_opencv_are_not_current(drawn, monkeypatch):
    monkeypatch.setattr(gallery.cv2, "__version__", "0.0")
    assert not Gallery([TRIAL], drawn).current()


@pytest.mark.parametrize("name", ["lap.webp", "fig4_deq-mcl.png"])
def test_a_figure_that_is_missing_or_was_changed_is_not_current(copy, name):
    content = (copy / name).read_bytes()
    for spoiled in (content[:-1], b"", content + b" "):
        (copy / name).write_bytes(spoiled)
        assert not Gallery([TRIAL], copy).current()
    (copy / name).unlink()
    assert not Gallery([TRIAL], copy).current()


@pytest.mark.parametrize("words", ["", "[]", "{}", '{"source": "", "sha256": 3}', "\x00"])
def test_a_spoiled_record_counts_as_none(copy, words):
    (copy / gallery.RECORD).write_text(words)
    assert not Gallery([TRIAL], copy).current()


def test_a_record_cannot_name_files_outside_its_folder(copy, tmp_path):
    precious = tmp_path / "precious.png"
    precious.write_bytes(b"kept")
    (copy / gallery.RECORD).write_text('{"source": "", "sha256": {"../precious.png": ""}}')
    Gallery([], copy).draw()
    assert precious.read_bytes() == b"kept"


def test_a_run_with_another_lag_removes_the_figures_that_it_does_not_draw(tmp_path):
    for lag in (20, 60):
        few = (*FEW, "--localizers", "deq-mcl", "--lag", lag, "--out", tmp_path)
        assert exit_code(*few) == 0
    assert set(files(tmp_path / "figures")) == {"fig4_deq-mcl.png", "lap.webp", gallery.RECORD}


def test_a_figure_that_was_lost_is_drawn_as_it_was_and_no_trial_is_run(tmp_path, monkeypatch):
    def fail(trial, room):
        raise AssertionError(f"{trial} was run again")

    assert exit_code(*FEW, "--localizers", "mcl", "--out", tmp_path) == 0
    before = files(tmp_path)
    (tmp_path / "figures" / "lap.webp").unlink()
    monkeypatch.setattr(attempt, "trial_moments", fail)
    assert exit_code(*FEW, "--localizers", "mcl", "--out", tmp_path) == 0
    assert files(tmp_path) == before
