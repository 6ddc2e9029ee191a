"""Random faults in the folder of a sweep: the same bytes in the end, or one sentence."""

import json
import os
import random
import shutil
import sys

import pytest
from sweep_command import report, sweep, tables, trial_files, write_small

from benchmarks.sweeps.store import _checksum

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="makes pipes and links")

FEW, MANY = 40, 1000  # cases by default, and with the slow tests


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """The folder of another sweep."""
    folder = tmp_path_factory.mktemp("other")
    assert sweep(write_small(folder, particles=14), folder / "out") == 0
    return folder / "out"


def leaves(value, at=()):
    """Places of all values in JSON that are no tables and no lists."""
    if isinstance(value, dict | list):
        keys = value if isinstance(value, dict) else range(len(value))
        return [place for key in keys for place in leaves(value[key], (*at, key))]
    return [at]


def mistyped(path, dice):
    """Put a value of another type somewhere, and sign the file again."""
    content = json.loads(path.read_text())
    *way, last = dice.choice(leaves(content))
    place = content
    for key in way:
        place = place[key]
    place[last] = ["x"] if isinstance(place[last], str) else "x"
    signed(path, content)


def signed(path, content):
    if "checksum" in content:
        content.pop("checksum")
        content["checksum"] = _checksum(content)
    path.write_text(json.dumps(content))


def of_other_schema(path, dice):
    content = json.loads(path.read_text())
    signed(path, content | {"schema": content.get("schema", 0) + dice.choice([-1, 1])})


def flipped(path, dice):
    content = bytearray(path.read_bytes())
    content[dice.randrange(len(content))] ^= 1 << dice.randrange(8)
    path.write_bytes(content)


def replaced(make):
    def fault(path, dice):
        path.unlink()
        make(path)

    return fault


def huge(path):
    with path.open("wb") as file:
        file.truncate(2**40)


FAULTS = {
    "torn": lambda path, dice: os.truncate(path, dice.randrange(path.stat().st_size)),
    "empty": lambda path, dice: os.truncate(path, 0),
    "deleted": lambda path, dice: path.unlink(),
    "renamed": lambda path, dice: path.rename(path.with_name(f"{dice.getrandbits(128):032x}.json")),
    "doubled": lambda path, dice: shutil.copy(
        path, path.with_name(f"{dice.random()}{path.suffix}")
    ),
    "over another": lambda path, dice: shutil.copy(
        path, dice.choice([p for p in path.parent.iterdir() if p.is_file() and p != path] or [None])
    ),
    "flipped": flipped,
    "of other schema": of_other_schema,
    "mistyped": mistyped,
    "nested": lambda path, dice: path.write_text("[" * 10**5),
    "a folder": replaced(lambda path: path.mkdir()),
    "a pipe": replaced(os.mkfifo),
    "a device": replaced(lambda path: path.symlink_to("/dev/zero")),
    "a dead link": replaced(lambda path: path.symlink_to("nowhere")),
    "huge": replaced(huge),
}
ADDED = {  # files of the user's
    "notes": "notes.txt",
    "temporary": "trials/.mine.tmp",
    "a page": "results.md",
    "a trial": "trials/mine.json",
    "a failure": f"failed/{0:032x}.json",
}


def spoil(folder, other, dice):
    """Do up to three things to a folder; return what, and the files that are the user's."""
    done, mine = [], {}
    for _ in range(dice.randint(1, 3)):
        kind = dice.choice([*FAULTS, *FAULTS, *ADDED, "of another sweep", "all of another sweep"])
        here = [p for p in sorted(folder.rglob("*")) if p.is_file() and not p.is_symlink()]
        here = [p for p in here if p not in mine]
        path = dice.choice([p for p in here if p.stat().st_size < 10**6] or [None])
        try:
            if kind in FAULTS:
                FAULTS[kind](path, dice)
                for own, words in mine.items():  # a fault of the test's own
                    own.write_text(words)
            elif kind in ADDED:
                path = folder / ADDED[kind]
                path.parent.mkdir(exist_ok=True)
                (folder / ".deqmcl.lock").touch()  # of a process that was killed
                path.write_text(words := f"{dice.random()}")
                mine[path] = words
            elif kind == "of another sweep":
                path = dice.choice([p for p in other.rglob("*") if p.is_file()])
                into = folder / path.relative_to(other)
                if into not in mine:
                    shutil.copy(path, into)
            else:
                shutil.copytree(other, folder, dirs_exist_ok=True)
        except (ValueError, OSError, TypeError, AttributeError, KeyError):
            continue  # it cannot be done to that file, or after what was done before
        done.append((kind, str(path)))
    return done, mine


def rows(folder):
    return set(tables(folder)["trials.csv"].splitlines())


def written_in(folder):
    """Times of the tables, whatever is in their place."""
    paths = [folder / name for name in ("results.csv", "trials.csv", "timings.csv")]
    return {path: path.lstat().st_mtime_ns for path in paths if os.path.lexists(path)}


def looked_at(code, said, done):
    """Whether it went well; if not, it was refused in one sentence."""
    assert code in (0, 2), (done, said)
    *notes, last = said.err.splitlines() or [""]
    notes += [last] if code == 0 and last else []
    ends = ("it is left out.", "it is run again.", "it is removed.", "files are left out.")
    assert all(note.startswith("deqmcl: ") and note.endswith(ends) for note in notes), (done, notes)
    if code == 2:
        assert last.startswith("deqmcl: "), (done, last)
        assert not last.endswith(ends), (done, last)
    return code == 0


def faulty(file, finished, other, folder, dice, capsys):
    """Spoil a copy of a folder, report it, run the sweep again."""
    shutil.copytree(finished, folder)
    done, mine = spoil(folder, other, dice)
    capsys.readouterr()
    if looked_at(report(folder), capsys.readouterr(), done):
        assert rows(folder) <= rows(finished) or rows(folder) <= rows(other), done  # never mixed
    before = written_in(folder)
    if looked_at(sweep(file, folder), capsys.readouterr(), done):
        assert tables(folder) == tables(finished), done
        for name, content in trial_files(finished).items():
            assert (folder / "trials" / name).read_bytes() == content, done
    else:
        assert written_in(folder) == before, done
    assert {path: path.read_text() for path in mine} == mine, done
    assert not list(folder.rglob(".deqmcl-*.tmp"))
    shutil.rmtree(folder)
    return bool(done)


@pytest.mark.parametrize(
    ("seed", "cases"), [(0, FEW), pytest.param(1, MANY, marks=pytest.mark.slow)]
)
def test_a_spoilt_folder_ends_in_the_same_bytes_or_in_one_sentence(
    file, finished, other, tmp_path, capsys, seed, cases
):
    dice = random.Random(seed)
    spoilt = sum(
        faulty(file, finished, other, tmp_path / str(n), dice, capsys) for n in range(cases)
    )
    assert spoilt > 0.9 * cases
