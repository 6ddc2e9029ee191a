"""The digest of a plug-in: of all that it is made of, and of nothing else."""

import sys
from functools import partial

import pytest

import localizers


def test_the_digest_of_a_file_changes_with_its_text_alone_wherever_it_lies(file, tmp_path):
    before = localizers.source_digest(f"{file}:Mine")
    (tmp_path / "elsewhere").mkdir()
    elsewhere = file.rename(tmp_path / "elsewhere" / file.name)
    (tmp_path / "elsewhere" / "other.py").write_text("x = 1")
    assert localizers.source_digest(f"{elsewhere}:Mine") == before
    elsewhere.write_text(elsewhere.read_text() + "\n")
    assert localizers.source_digest(f"{elsewhere}:Mine") != before


def test_the_digest_of_a_module_covers_its_package(module, install):
    install("theirs = pack.good:Mine")
    before = localizers.source_digest("pack.good:Mine")
    assert localizers.source_digest("theirs") == before
    (module / "torn.py").write_text("x = 1")
    assert localizers.source_digest("pack.good:Mine") != before


def test_the_digest_runs_nothing_so_what_cannot_be_imported_has_one_but_what_is_not_there(module):
    expected = localizers.source_digest("pack.good:Mine")
    for name in ("pack.raises:Mine", "pack.torn:Mine", "pack.gone:Mine"):
        assert localizers.source_digest(name) == expected
    assert localizers.source_digest("pack/torn.py:Mine") is not None
    for name in ("no_such_pack:Mine", "no_such_file.py:Mine", ":", "..:Mine"):
        assert localizers.source_digest(name) is None
    assert not [name for name in sys.modules if name.partition(".")[0] == "pack"]


def test_built_in_localizers_have_no_digest_of_their_own_and_registered_ones_that_of_their_file(
    file,
):
    assert {localizers.source_digest(name) for name in localizers.names()} == {None}
    factory = localizers.resolve(f"{file}:Mine")
    expected = localizers.source_digest(f"{file}:Mine")
    for own in (factory, partial(factory, gain=2.0)):
        with localizers.registered("mine", own):
            assert localizers.source_digest("mine") == expected


SHIPS = """
SHIPS = ("table.bin", "nets/layer-*.npy", "*.onnx", "folder", "", "/table", "absent")
class Mine:
    def __init__(self, robot): self.table = open("results.csv")
"""


@pytest.mark.parametrize(
    ("name", "covered"),
    [
        *((name, True) for name in ("ships.npz", "table.bin", "nets/layer-0.npy", "a.onnx")),
        ("folder/deep/er.bin", True),
        # of somebody else, or not declared
        *((name, False) for name in ("other.bin", "other/table.bin", "results.csv", "other.py")),
        ("__pycache__/ships.cpython-311.pyc", False),
    ],
)
@pytest.mark.parametrize("new", [b"other weights", None])
def test_the_digest_of_a_file_covers_the_files_that_it_declares_or_that_have_its_name(
    tmp_path, name, covered, new
):
    (tmp_path / "ships.py").write_text(SHIPS)
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_bytes(b"weights")
    before = localizers.source_digest(f"{tmp_path}/ships.py:Mine")
    path.unlink() if new is None else path.write_bytes(new)
    assert (localizers.source_digest(f"{tmp_path}/ships.py:Mine") != before) == covered


@pytest.mark.parametrize(
    ("name", "covered"),
    [("weights.npz", True), ("deep/er/w.bin", True), ("__pycache__/good.cpython-311.pyc", False)],
)
def test_the_digest_of_a_package_covers_all_that_it_ships(module, name, covered):
    before = localizers.source_digest("pack.good:Mine")
    (module / name).parent.mkdir(parents=True, exist_ok=True)
    (module / name).write_bytes(b"weights")
    assert (localizers.source_digest("pack.good:Mine") != before) == covered
