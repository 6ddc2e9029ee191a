"""Random faults in the folder of a sweep: the same tables in the end, or one sentence."""

import os
import random
import shutil
import sys

import pytest
from deqmcl_command import stored
from sweep_command import report, sweep, tables

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="makes pipes and links")


def flipped(path, dice):
    content = bytearray(path.read_bytes())
    content[dice.randrange(len(content))] ^= 1 << dice.randrange(8)
    path.write_bytes(content)


def spliced(path, dice):
    """Two processes wrote at once, as on a network disk without locks."""
    content = path.read_bytes()
    here, there = sorted(dice.randrange(len(content)) for _ in range(2))
    path.write_bytes(content[:there] + content[here:])


def replaced(make):
    def fault(path, dice):
        path.unlink()
        make(path)

    return fault


FAULTS = {
    "torn": lambda path, dice: os.truncate(path, dice.randrange(path.stat().st_size)),
    "deleted": lambda path, dice: path.unlink(),
    "doubled": lambda path, dice: path.write_bytes(2 * path.read_bytes()),
    "flipped": flipped,
    "spliced": spliced,
    "zeroed": lambda path, dice: path.write_bytes(path.read_bytes()[:1000] + bytes(1000)),
    "nested": lambda path, dice: path.write_text("[" * 10**5),
    "a folder": replaced(lambda path: path.mkdir()),
    "a pipe": replaced(os.mkfifo),
}


def looked_at(code, said, done):
    """Whether it went well; if not, it was refused in one sentence."""
    assert code in (0, 2), (done, said)
    *notes, last = said.err.splitlines() or [""]
    notes += [last] if code == 0 and last else []
    assert all(note.startswith("deqmcl: ") and "left out" in note for note in notes), (done, notes)
    if code == 2:
        assert last.startswith("deqmcl: "), (done, last)
    return code == 0


def faulty(file, finished, folder, dice, capsys):
    """Spoil a file or two of a copy of a folder, report it, run the sweep again."""
    shutil.copytree(finished, folder)
    done = []
    for name in dice.choices(["trials.jsonl", "trials.jsonl", "manifest.json"], k=2):
        kind = dice.choice([*FAULTS])
        if (folder / name).is_file() and (folder / name).stat().st_size:
            FAULTS[kind](folder / name, dice)
            done.append((kind, name))
    capsys.readouterr()
    looked_at(report(folder), capsys.readouterr(), done)
    before = stored(folder) if (folder / "trials.jsonl").is_file() else {}
    if looked_at(sweep(file, folder), capsys.readouterr(), done):
        assert tables(folder) == tables(finished), done
    elif before:
        assert stored(folder) == before, done
    shutil.rmtree(folder)


@pytest.mark.parametrize(("seed", "cases"), [(0, 15), pytest.param(1, 300, marks=pytest.mark.slow)])
def test_a_spoilt_folder_ends_in_the_same_tables_or_in_one_sentence(
    file, finished, tmp_path, capsys, seed, cases
):
    dice = random.Random(seed)
    for number in range(cases):
        faulty(file, finished, tmp_path / str(number), dice, capsys)
