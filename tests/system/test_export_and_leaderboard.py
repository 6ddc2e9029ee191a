"""``deqmcl export`` and ``deqmcl leaderboard`` on folders of real sweeps."""

import json
import re
import shutil

import pytest

from benchmarks.cli import main

SWEEP = """
title = "{title}"
scenario = "sharp"
localizers = [{localizers}]
trials = {trials}
params = {{ particles = 20 }}
seed = {seed}
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Run a sweep of these localizers once; return its folder."""
    root, there = tmp_path_factory.mktemp("swept"), {}

    def run(*localizers, trials=2, seed=0):
        key = (localizers, trials, seed)
        if key not in there:
            file = root / f"s{len(there)}.toml"
            named = ", ".join(f'"{name}"' for name in localizers)
            file.write_text(
                SWEEP.format(title=file.stem, localizers=named, trials=trials, seed=seed)
            )
            there[key] = root / file.stem
            assert main(["sweep", str(file), "--out", str(there[key]), "--jobs", "1"]) == 0
        return there[key]

    return run


def refused(capsys, *command):
    """What is said of a command that must fail with one sentence."""
    capsys.readouterr()
    assert main(list(map(str, command))) == 2
    lines = [one for one in capsys.readouterr().err.splitlines() if not one.endswith("…")]
    assert len(lines) == 1
    return lines[0]


def test_an_export_has_tables_figures_and_bibtex_and_can_be_made_again(swept, tmp_path, capsys):
    folder = swept("mcl", "mcl-map")
    for flags, made in (
        ((), {"tables.tex", "references.bib", "document.tex", "figures"}),
        (("--latex",), {"tables.tex", "references.bib", "document.tex"}),
        (("--pdf",), {"figures"}),
    ):
        assert main(["export", str(folder), "--out", str(tmp_path / "out"), *flags]) == 0
        there = {one.name for one in (tmp_path / "out").iterdir() if any_file(one)}
        assert there == made | {"written.json"}
    assert "figures/points-1.pdf" in capsys.readouterr().out


def any_file(path):
    return path.is_file() or any(path.iterdir())


def test_an_export_refuses_what_is_not_a_folder_of_results_and_writes_nothing(
    swept, tmp_path, capsys
):
    assert "holds no manifest.json" in refused(capsys, "export", tmp_path)
    assert [*tmp_path.iterdir()] == []
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("mine")
    said = refused(capsys, "export", swept("mcl", "mcl-map"), "--out", tmp_path / "mine")
    assert "holds files, but none of this command's" in said
    assert [one.name for one in (tmp_path / "mine").iterdir()] == ["thesis.tex"]


def test_a_leaderboard_ranks_the_methods_of_all_folders_once_with_their_origin(swept, tmp_path):
    folders = [swept("mcl", "mcl-map"), swept("mcl", "dead-reckoning")]
    out = tmp_path / "board"
    assert main(["leaderboard", *map(str, folders), "--out", str(out)]) == 0
    text = (out / "leaderboard.md").read_text(encoding="utf-8").replace("*", "")
    board, runs = (
        [[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()[2:]]
        for block in text.split("\n\n")
        if block.startswith("|")
    )
    ranks, names = zip(*(line[0].split(". ") for line in board), strict=True)
    assert ranks == ("1", "1", "3")  # mcl and mcl-map are equal on these worlds
    assert sorted(names) == ["dead-reckoning", "mcl (baseline)", "mcl-map"]
    errors = [float(line[1].split()[0]) for line in board]
    assert errors == sorted(errors)
    assert board[names.index("dead-reckoning")][7] == "2"
    assert board[names.index("mcl (baseline)")][7] == "1, 2"
    made = [json.loads((one / "manifest.json").read_text()) for one in folders]
    for line, one in zip(runs, made, strict=True):
        assert line[4] == one["identity"]["code"]
        assert line[2].replace("\\", "") == " ".join(["deqmcl", *one["command"][1:]])
        assert f"numpy {one['identity']['libraries']['numpy']}" in line[3]
    assert all(line[6] == made[0]["identity"]["code"][:12] for line in board)
    page = (out / "leaderboard.html").read_text(encoding="utf-8")
    assert len(re.findall("<tr", page)) == len(board) + len(runs) + 2


OTHERS = {"trials was 2 and is 3": {"trials": 3}, "seed was 0 and is 7": {"seed": 7}}


@pytest.mark.parametrize("why", OTHERS)
def test_a_leaderboard_refuses_other_worlds_and_says_which(why, swept, tmp_path, capsys):
    first, other = swept("mcl", "mcl-map"), swept("mcl", "mcl-map", **OTHERS[why])
    said = refused(capsys, "leaderboard", first, other, "--out", tmp_path / "board")
    assert said.startswith(f"deqmcl: {other} is not comparable with {first} ({why})")
    assert not (tmp_path / "board").exists()


def test_a_leaderboard_refuses_folders_twice_without_the_baseline_or_with_trials_missing(
    swept, tmp_path, capsys
):
    first, without = swept("mcl", "mcl-map"), swept("mcl-map")
    board = tmp_path / "board"
    assert "given twice" in refused(capsys, "leaderboard", first, first, "--out", board)
    said = refused(capsys, "leaderboard", first, without, "--out", board)
    assert f"{without} has no trial of the baseline mcl" in said
    part = tmp_path / "part"
    shutil.copytree(first, part)
    next((part / "trials").iterdir()).unlink()
    said = refused(capsys, "leaderboard", first, part, "--out", board)
    assert f"{part} has 1 trials that were not run and 0 that failed, of 4" in said
    assert not board.exists()


def test_a_leaderboard_refuses_a_baseline_with_other_scores(swept, tmp_path, monkeypatch, capsys):
    from benchmarks.report import leaderboard

    first, other = swept("mcl", "mcl-map"), swept("mcl", "dead-reckoning")
    read = leaderboard.results_in

    def changed(folder):
        found = read(folder)
        if folder == other:
            for record in found.records:
                record.scores[0]["error"] += 1e-9
        return found

    monkeypatch.setattr(leaderboard, "results_in", changed)
    said = refused(capsys, "leaderboard", first, other, "--out", tmp_path / "board")
    assert "the baseline mcl has other scores on world 0" in said
