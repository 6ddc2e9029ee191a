"""``deqmcl report`` for a paper and of several folders, all of real sweeps."""

import json
import os
import shutil

import pytest
from deqmcl_command import files, lose, python
from sweep_command import report, sweep, tables

SWEEP = """
title = "{title}"
scenario = "sharp"
localizers = [{localizers}]
trials = {trials}
params = {{ particles = 20 }}
seed = {seed}
"""
DRIVEN = "[[vary]]\nagent = [{}]\n"
BROKEN = "sweep_command:broken"


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Run a sweep of these localizers once; return its folder."""
    root, there = tmp_path_factory.mktemp("swept"), {}

    def run(*localizers, trials=2, seed=0, more="", fails=False):
        key = (localizers, trials, seed, more)
        if key not in there:
            file = root / f"s{len(there)}.toml"
            named = ", ".join(name if "{" in name else f'"{name}"' for name in localizers)
            what = {"localizers": named, "trials": trials, "seed": seed}
            file.write_text(SWEEP.format(title=file.stem, **what) + more)
            there[key] = root / file.stem
            assert sweep(file, there[key]) == (3 if fails else 0)
        return there[key]

    return run


def test_a_report_for_a_paper_has_tables_and_bibtex_and_then_its_figures_too(
    swept, tmp_path, capsys
):
    folder, out = swept("mcl", "mcl-map"), tmp_path / "out"
    made = {"tables.tex", "references.bib"}
    for flag, more in (("--latex", set()), ("--pdf", {"figures"})):
        assert report(folder, "--out", out, flag) == 0
        made |= more
        assert {name.partition("/")[0] for name in files(out / "export")} == made
        assert ("export/figures/points-1.pdf" in capsys.readouterr().out) == (flag == "--pdf")


def test_no_setting_of_matplotlib_that_a_user_has_changes_a_chart(swept, tmp_path):
    folder, style = swept("mcl", "mcl-map"), tmp_path / "matplotlibrc"
    style.write_text("text.usetex: True\nfont.size: 30\nsavefig.bbox: tight\naxes.facecolor: red\n")
    assert report(folder, "--pdf", "--out", tmp_path / "here") == 0
    theirs = {"MATPLOTLIBRC": str(style), "MPLBACKEND": "module://of_a_notebook"}
    command = ("-m", "benchmarks", "report", folder, "--pdf", "--out", tmp_path / "there")
    python(*command, env=os.environ | theirs)
    assert files(tmp_path / "there" / "export") == files(tmp_path / "here" / "export")


def pooled(out, *folders):
    """Pool folders, the tables only; return their bytes by name."""
    assert report(*folders, "--out", out) == 0
    return tables(out)


def test_folders_are_pooled_as_if_one_sweep_had_run_all_their_methods(swept, tmp_path, capsys):
    parts = [swept("mcl", "mcl-map"), swept("mcl", "dead-reckoning")]
    together = tables(swept("mcl", "mcl-map", "dead-reckoning"))
    capsys.readouterr()
    assert pooled(tmp_path / "pooled", *parts) == together
    assert capsys.readouterr().out.startswith("6 of 6 trials finished.\n")
    assert pooled(tmp_path / "twice", parts[0], parts[0]) == tables(parts[0])


def test_agents_that_drive_in_the_same_worlds_are_pooled_too(swept, tmp_path):
    apart = (swept("mcl", trials=1, more=DRIVEN.format(f'"{one}"')) for one in ("still", "spin"))
    together = swept("mcl", trials=1, more=DRIVEN.format('"still", "spin"'))
    assert pooled(tmp_path / "pooled", *apart) == tables(together)


def test_folders_of_other_worlds_are_not_pooled_and_the_difference_is_said(
    swept, tmp_path, refusal
):
    first, other = swept("mcl", "mcl-map"), swept("mcl", "mcl-map", seed=7)
    words = f"deqmcl: {other} is not comparable with {first} (seed was 0 and is 7): give"
    refusal(["report", first, other, "--out", tmp_path / "pooled"], words)
    assert not (tmp_path / "pooled").exists()


def test_folders_of_other_code_or_plug_ins_are_not_pooled(swept, tmp_path, refusal):
    first = swept("mcl", BROKEN, fails=True)
    for edit, why in (
        (lambda made: made | {"code": "0" * 64}, f"is '{'0' * 20}"),
        (lambda made: made | {"plug-ins": {BROKEN: "0" * 64}}, f"plug-ins.{BROKEN} was"),
    ):
        other = shutil.copytree(first, tmp_path / "other", dirs_exist_ok=True)
        content = json.loads((first / "manifest.json").read_text())
        content["identity"] = edit(content["identity"])
        (other / "manifest.json").write_text(json.dumps(content))
        lose(other)  # they are of the code that the manifest had
        refusal(["report", first, other, "--out", tmp_path / "pooled"], "not comparable", why)


def test_folders_that_stopped_when_they_were_decided_are_not_pooled(swept, tmp_path, refusal):
    until = {"trials": 20, "more": "[until_decided]\nmargin = 0.5\n"}
    folders = [swept("mcl", "mcl-map", **until), swept("mcl", "dead-reckoning", **until)]
    refusal(["report", *folders, "--out", tmp_path / "pooled"], "until_decided", "fixed number")


def test_folders_that_are_not_complete_or_without_an_own_output_are_not_pooled(
    swept, tmp_path, refusal
):
    first, other = swept("mcl", "mcl-map"), swept("mcl", "dead-reckoning")
    part = shutil.copytree(first, tmp_path / "part")
    lose(part, 0)
    for words, why in (
        ((other, part, "--out", tmp_path / "pooled"), f"{part} lacks 1 of its 4 trials: finish"),
        ((first, other), "give --out DIR"),
        ((first, other, "--out", first), "give --out DIR"),
        ((first, other, "--out", other), f"the output folder {other} holds files"),
    ):
        refusal(["report", *words], why)
    assert not (tmp_path / "pooled").exists()
