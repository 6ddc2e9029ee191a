"""Files that are made again only if they have to be, and never in the place of others."""

import json

import pytest

from benchmarks.files import inventory, own_folder, refuse_changed, write_part, written
from deqmcl_gym.validation import InputError

FILES = {"a.csv": b"a", "images/b.svg": b"b"}


def contents(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


def make(folder, files=FILES, source="source"):
    """Whether files are made at a call, and which there are then."""
    made = []
    paths = written(folder, "part", source, lambda: made.append(1) or files)
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
    assert contents(made).keys() == {"a.csv", "written.json"}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("files", [FILES, {"a.csv": b"new", "images/b.svg": b"new"}, {}])
def test_a_file_that_was_changed_is_neither_overwritten_nor_removed(made, name, files):
    (made / name).write_bytes(b"a note of mine")
    before = contents(made)
    for act in (lambda: make(made, files, "another"), lambda: refuse_changed(made)):
        with pytest.raises(InputError, match=rf"{name} is not as deqmcl wrote it"):
            act()
    assert contents(made) == before


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
        with pytest.raises(InputError, match="not as deqmcl wrote it"):
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
    assert contents(made).keys() == {*new, "written.json"}


@pytest.mark.parametrize(
    "words",
    ["", "[]", '{"part": 3}', '{"part": {"source": "", "files": 3}}', "\x00", "[" * 100_000]
    + [json.dumps({"part": {"source": "", "files": {name: []}}})
       for name in ("../precious", "/tmp/../tmp/precious", "images/../../precious", ".")],
)  # fmt: skip
def test_a_record_that_is_not_ours_or_leads_elsewhere_is_refused(tmp_path, words):
    (tmp_path / "precious").write_text("kept")
    out = tmp_path / "out"
    out.mkdir()
    (out / "written.json").write_text(words)
    for act in (make, refuse_changed, lambda folder: own_folder(folder, "part")):
        with pytest.raises(InputError, match=r"written\.json .* not as deqmcl wrote it"):
            act(out)
    assert contents(tmp_path) == {"precious": b"kept", "out/written.json": words.encode()}


def test_a_folder_of_others_is_refused_before_anything_is_written(tmp_path):
    (mine := tmp_path / "mine").mkdir()
    (mine / ".notes.tmp").write_text("x")
    write_part(tmp_path / "report", "report", FILES)
    before = contents(tmp_path)
    for folder in (mine, tmp_path / "report"):
        with pytest.raises(InputError, match="holds files, but none of this command's"):
            own_folder(folder, "run")
    assert contents(tmp_path) == before
    assert own_folder(tmp_path / "report", "report").is_dir()
    for name in (".deqmcl.lock", ".deqmcl-a1b2c3d4.tmp"):  # of a process that was killed
        (killed := tmp_path / name.strip(".")).mkdir()
        (killed / name).touch()
        assert own_folder(killed, "run").is_dir()
