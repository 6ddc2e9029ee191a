"""Files in a folder: whole or not there, made again only if need be, locked by one command."""

import errno
import json
import os
import tempfile
from pathlib import Path

import pytest
from deqmcl_command import files
from refusals import refused

from benchmarks import files as inventory
from benchmarks.files import own_folder, refuse_changed, write_part, written
from deqmcl_gym.files import writable_folder, write_text

FILES = {"a.csv": b"a", "images/b.svg": b"b"}


def make(folder, made_of=FILES, source="source"):
    """Whether files are made at a call, and which there are then."""
    made = []
    paths = written(folder, "part", source, lambda: made.append(1) or made_of)
    return bool(made), [path.relative_to(folder).as_posix() for path in paths]


@pytest.fixture
def made(tmp_path):
    assert make(tmp_path) == (True, list(FILES))
    return tmp_path


def test_files_that_are_there_are_not_made_again_and_are_listed(made):
    assert make(made) == (False, list(FILES))
    assert make(made, source="another") == (True, list(FILES))


def test_a_file_that_is_gone_is_made_again_and_one_that_is_no_longer_made_is_removed(made):
    (made / "images" / "b.svg").unlink()
    assert make(made) == (True, list(FILES))
    assert make(made, {"a.csv": b"other"}, "another") == (True, ["a.csv"])
    assert files(made).keys() == {"a.csv", "written.json"}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("new", [FILES, {"a.csv": b"new", "images/b.svg": b"new"}, {}])
def test_a_file_that_was_changed_is_neither_overwritten_nor_removed(made, name, new):
    (made / name).write_bytes(b"a note of mine")
    before = files(made)
    for act in (lambda: make(made, new, "another"), lambda: refuse_changed(made)):
        with refused(f"{name} is not as deqmcl wrote it"):
            act()
    assert files(made) == before


@pytest.mark.parametrize("place", ["a.csv", "images", "images/b.svg"])
def test_nothing_is_written_over_a_link_a_folder_or_a_file_that_was_there(tmp_path, place):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for number, put in enumerate(
        (
            lambda path: path.symlink_to(elsewhere),
            lambda path: path.mkdir() if path.name != "images" else path.write_bytes(b"a"),
            lambda path: path.write_bytes(b"mine"),
        )
    ):
        out = tmp_path / str(number)
        (out / place).parent.mkdir(parents=True)
        put(out / place)
        with refused("not as deqmcl wrote it"):
            make(out)
        assert not (out / "written.json").exists()
    assert list(elsewhere.iterdir()) == []


@pytest.mark.parametrize("at", range(1, 5))
def test_a_write_that_is_interrupted_anywhere_is_made_up_for_by_the_next(made, monkeypatch, at):
    new, writes, really = {"a.csv": b"A", "c.csv": b"C"}, [], inventory.write_bytes

    def interrupted(path, content):
        writes.append(path)
        if len(writes) == at:
            raise KeyboardInterrupt
        really(path, content)

    with monkeypatch.context() as patch:
        patch.setattr(inventory, "write_bytes", interrupted)
        patch.setattr(inventory, "write_text", lambda p, text: interrupted(p, text.encode()))
        with pytest.raises(KeyboardInterrupt):
            make(made, new, "new")
    assert make(made, new, "new") == (True, list(new))
    assert files(made).keys() == {*new, "written.json"}


@pytest.mark.parametrize(
    "words",
    ["", "[]", '{"part": 3}', '{"part": {"source": "", "files": 3}}', "\x00", "[" * 100_000]
    + [json.dumps({"part": {"source": "", "files": {name: []}}})
       for name in ("../precious", "/tmp/../tmp/precious", "images/../../precious", ".",
                    "a\0b", "n" * 300, "n" * 300 + "/b", "\ud800")],
)  # fmt: skip
def test_a_record_that_is_not_ours_or_leads_elsewhere_is_refused(tmp_path, words):
    (tmp_path / "precious").write_text("kept")
    out = tmp_path / "out"
    out.mkdir()
    (out / "written.json").write_text(words)
    for act in (make, refuse_changed, lambda folder: own_folder(folder, "part")):
        with refused("written.json ", " not as deqmcl wrote it"):
            act(out)
    assert files(tmp_path) == {"precious": b"kept", "out/written.json": words.encode()}


@pytest.mark.skipif(os.name == "nt", reason="no such permissions there")
@pytest.mark.parametrize("mask", [0o077, 0o022, 0o002])
def test_files_have_the_permissions_of_the_umask(tmp_path, mask):
    before = os.umask(mask)
    try:
        write_text(tmp_path / "new", "")
    finally:
        os.umask(before)
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o666 & ~mask


def test_a_folder_of_others_is_refused_before_anything_is_written(tmp_path):
    (mine := tmp_path / "mine").mkdir()
    (mine / ".notes.tmp").write_text("x")
    write_part(tmp_path / "report", "report", FILES)
    before = files(tmp_path)
    for folder in (mine, tmp_path / "report"):
        with refused("holds files, but none of this command's"):
            own_folder(folder, "run")
    assert files(tmp_path) == before
    assert own_folder(tmp_path / "report", "report").is_dir()
    for name in (".deqmcl.lock", ".deqmcl-a1b2c3d4.tmp"):  # of a process that was killed
        (killed := tmp_path / name.strip(".")).mkdir()
        (killed / name).touch()
        assert own_folder(killed, "run").is_dir()


@pytest.mark.parametrize("broken", ["fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
def test_a_write_that_fails_leaves_the_old_file_and_nothing_beside_it(
    tmp_path, monkeypatch, broken, error
):
    target = tmp_path / "table.csv"
    write_text(target, "old\n")

    def fail(*_):
        raise error

    monkeypatch.setattr(os, broken, fail)
    with pytest.raises(type(error)) as caught:
        write_text(target, "new\n")
    # which file, for the reader of the message
    assert isinstance(error, KeyboardInterrupt) or caught.value.filename == str(target)
    assert sorted(os.listdir(tmp_path)) == ["table.csv"]
    assert target.read_text() == "old\n"


def test_a_write_becomes_visible_only_when_it_is_whole(tmp_path, monkeypatch):
    target = tmp_path / "table.csv"
    write_text(target, "old\n")
    really, seen = os.replace, []

    def look(source, destination):
        seen.append((target.read_text(), Path(source).read_text(), Path(source).parent))
        really(source, destination)

    monkeypatch.setattr(os, "replace", look)
    write_text(target, "new\n")
    assert seen == [("old\n", "new\n", tmp_path)]
    assert target.read_text() == "new\n"


@pytest.mark.parametrize("kind", [errno.EACCES, errno.EROFS, errno.ENOSPC])
def test_a_folder_in_which_no_file_can_be_made_is_refused_with_the_reason(
    tmp_path, monkeypatch, kind
):
    def fail(**_):
        raise OSError(kind, os.strerror(kind))

    monkeypatch.setattr(tempfile, "TemporaryFile", fail)
    with refused(os.strerror(kind), str(tmp_path)):
        writable_folder(tmp_path)


@pytest.fixture(params=["posix", "windows"])
def system(request, monkeypatch):
    """As here; or where there is no flock, and nothing that is open can be removed."""
    if request.param == "posix":
        return pytest.importorskip("fcntl")
    opened = []
    really_open, really_unlink = Path.open, Path.unlink

    def remember(path, *arguments):
        file = really_open(path, *arguments)
        opened.append((path, file))
        return file

    def unlink(path, missing_ok=False):
        if any(path == other and not file.closed for other, file in opened):
            raise PermissionError(13, "The process cannot access the file", str(path))
        really_unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(inventory, "fcntl", None)
    monkeypatch.setattr(Path, "open", remember)
    monkeypatch.setattr(Path, "unlink", unlink)
    return None


def test_shards_share_a_folder_the_same_one_does_not_and_the_last_removes_the_lock(
    system, tmp_path
):
    there = tmp_path / ".deqmcl.lock"
    for first, second in ((None, None), ("1/2", None), ("1/2", "1/2"), ("1/2", "2/2")):
        with inventory.locked(tmp_path, first):
            if second == "2/2":
                with inventory.locked(tmp_path, second):
                    pass
            elif system:
                with refused("another sweep"), inventory.locked(tmp_path, second):
                    pass
            assert there.exists()
        assert os.listdir(tmp_path) == []
