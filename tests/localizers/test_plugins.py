"""One resolver for every way to name a localizer, and what it says when there is none."""

import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor

import pytest

import localizers
from deqmcl_gym.validation import InputError
from localizers.naming import registry
from localizers.naming.installed import unreadable


def refusal(name):
    with pytest.raises(InputError) as caught:
        localizers.resolve(name)
    text = str(caught.value)
    assert "\n" not in text
    assert text.endswith(".")
    assert name in text  # whose fault it is
    return text


@pytest.mark.parametrize("name", ["pack.good:Mine", "pack/good.py:Mine", "pack.good:Outer.Inner"])
def test_a_module_or_a_file_is_resolved_with_its_parameters(robot, module, name):
    assert localizers.parameters(name) == ("gain",)
    assert localizers.make(name, robot, gain=2.0).gain == 2.0
    with pytest.raises(InputError, match="did you mean 'gain'"):
        localizers.make(name, robot, gian=2.0)
    assert localizers.parameters("pack.good:OnlyRobot") == ()


def test_a_relative_path_and_its_absolute_name_are_the_same_localizer(file, monkeypatch):
    monkeypatch.chdir(file.parent)
    absolute = localizers.absolute_name("./mine.py:Mine")
    assert absolute == localizers.absolute_name(absolute) == f"{file}:Mine"
    assert localizers.resolve("mine.py:Mine") is localizers.resolve(absolute)


@pytest.mark.parametrize("name", ["mcl", "pack.good:Mine", "never-heard-of"])
def test_absolute_names_of_all_else_are_the_names(name):
    assert localizers.absolute_name(name) == name


def test_an_entry_point_is_listed_last_and_loaded_only_when_used(robot, module, install):
    install("theirs = pack.good:Mine\nbroken = pack.raises:Mine [extra]\nmcl = pack.good:Mine")
    assert localizers.names()[-2:] == ("broken", "theirs")
    assert not [name for name in sys.modules if name.partition(".")[0] == "pack"]
    assert type(localizers.make("theirs", robot)).__name__ == "Mine"
    assert "pack.raises" not in sys.modules
    assert localizers.resolve("mcl") is registry.mcl  # the built-in one goes first
    assert "its own code raised ArithmeticError: no luck (raises.py, line 2)" in refusal("broken")


@pytest.mark.parametrize("value", ["no_such_pack:Mine", "pack.good", "pack.good:Gone", "::", ":x"])
def test_a_broken_entry_point_breaks_only_its_own_use(module, install, value):
    install(f"broken = {value}")
    assert {"broken", "mcl"} <= set(localizers.names())
    refusal("broken")


def test_an_entry_point_of_two_packages_is_refused_unless_they_agree(module, install):
    install("theirs = pack.good:Mine\nsame = pack.good:Mine", "one")
    install("theirs = pack.good:OnlyRobot\nsame = pack.good:Mine", "two")
    assert "pack.good:Mine and pack.good:OnlyRobot" in refusal("theirs")
    localizers.resolve("same")


MALFORMED = (  # what importlib.metadata makes of them differs with the version of Python
    b"[deqmcl.localizers]\nno equals sign\n",
    b"[deqmcl.localizers]\nmine = pack.good:Mine\nno equals sign\n",
    b"[deqmcl.localizers]\n = pack.good:Mine\n",
    b"[deqmcl.localizers\nmine = pack.good:Mine\n",
    b"no section\n",
    b"[console_scripts]\nrun\n",
    b"\xff\xfe\0",
)


@pytest.mark.parametrize("text", MALFORMED)
def test_malformed_entry_points_of_one_package_hide_no_other_and_are_named(
    module, install, tmp_path, text
):
    install("theirs = pack.good:Mine")
    install("", "malformed")
    (tmp_path / "site-malformed" / "malformed-1.0.dist-info" / "entry_points.txt").write_bytes(text)
    assert localizers.names()[-1] == "theirs"
    localizers.resolve("theirs")
    said = refusal("dec-mcl")
    named = "(the entry points of malformed cannot be read)" in said
    assert named == (unreadable() == ["malformed"])


def test_a_package_without_a_name_hides_no_other(module, install, tmp_path):
    install("theirs = pack.good:Mine")
    for metadata in (None, b"\xff\xfe\0", b""):
        info = tmp_path / "site-other" / f"x{metadata!r:.3}.dist-info"
        info.mkdir()
        if metadata is not None:
            (info / "METADATA").write_bytes(metadata)
    assert localizers.names()[-1] == "theirs"


@pytest.mark.parametrize("text", ["", "class Other:\n    pass\n\n", "def _other(robot): ...\n"])
def test_a_file_with_one_localizer_is_completed_by_its_name_without_being_run(tmp_path, text):
    file = tmp_path / "one.py"
    one = "class One:\n    def reset(self, p, a, r): ...\n    def update(self, r, a, p): ...\n"
    file.write_text(f"{text}{one}\nraise SystemExit(1)\n")
    assert registry.complete(str(file)) == f"{file}:One"
    for name in ("mcl", "pack.good:Mine", f"{file}:One", "never-heard-of"):
        assert registry.complete(name) == name


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("dec-mcl", ["did you mean 'deq-mcl'?", "package.module:NAME", "path/to/file.py:NAME"]),
        ("no_such_pack:Mine", ["no module is named 'no_such_pack'", "PYTHONPATH"]),
        ("pack.goood:Mine", ["no module is named 'pack.goood' (did you mean 'good'?)"]),
        ("pack.good.deep:Mine", ["no module is named 'pack.good.deep'"]),
        ("pack.good:Mien", ["pack.good has no 'Mien' (did you mean 'Mine'?)", "OnlyRobot"]),
        ("pack.good:number", ["is an int", "must be a class or a function"]),
        ("pack.good:NoRobot", ["takes no robot", "factory(robot"]),
        ("pack.good:", ["must be package.module:NAME"]),
        (":Mine", ["must be package.module:NAME"]),
        ("pack.good:Mine()", ["must be package.module:NAME"]),
        ("..good:Mine", ["cannot be imported"]),
        ("pack/goood.py:Mine", ["No such file", "(did you mean 'good.py'?)"]),
        ("far/good.py:Mine", ["No such file"]),
        ("./:Mine", ["is a folder"]),
        ("pack/good.py", ["has Mine, OnlyRobot, NoRobot", "as in pack/good.py:Mine"]),
        ("pack/raises.py", ["has no class with reset and update", "as in pack/raises.py:NAME"]),
        ("pack/torn.py", ["cannot be parsed as Python: invalid syntax (torn.py, line 2)"]),
        ("pack/gone.py", ["No such file"]),
    ],
)
def test_what_cannot_be_resolved_is_said_in_one_sentence(module, name, words):
    said = refusal(name)
    for word in words:
        assert word in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def (:\n", "bad.py, line 1: "),
        ("x = '\0'\n", "null"),
        ("import no_such_dependency\n", "its own code raised ModuleNotFoundError: No module named"),
        ("\n\nx = 1 / 0\n", "ZeroDivisionError: division by zero (bad.py, line 3)."),
        ("def __getattr__(name):\n    1 / 0\n", "ZeroDivisionError: division by zero (bad.py"),
        ("import sys\nsys.exit('bye')\n", "SystemExit: bye (bad.py, line 2)."),
        (
            "from deqmcl_gym.validation import InputError as E\nraise E('mine.')",
            "InputError: mine (",
        ),
        ("", "has no 'Mine'; it defines nothing."),
        ("from localizers import PoseBelief\ndef mines(robot): ...", "defines mines."),
    ],
)
def test_bad_code_is_said_in_one_sentence_and_a_file_is_read_again_when_mended(module, text, words):
    (module / "bad.py").write_text(text)
    for name in ("pack.bad:Mine", "pack/bad.py:Mine"):
        assert words in refusal(name)
    (module / "bad.py").write_text((module / "good.py").read_text())
    localizers.resolve("pack/bad.py:Mine")


@pytest.mark.parametrize(
    ("attribute", "error", "words"),
    [
        ("NoUpdate", RuntimeError, "is a NoUpdate without update: a localizer has reset"),
        ("none", RuntimeError, "is None without reset and update"),
        ("refuses", ValueError, "not this robot"),  # as the constructor raised it
    ],
)
def test_what_is_no_localizer_is_refused_when_it_is_made(robot, file, attribute, error, words):
    with pytest.raises(error, match=words):
        localizers.make(f"{file}:{attribute}", robot)


def test_a_file_is_resolved_again_in_a_spawned_process(file, monkeypatch):
    monkeypatch.chdir(file.parent)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        for name in ("mine.py:Mine", f"{file}:Mine"):
            asked = [(localizers.parameters, (name,)), (localizers.source_digest, (name,))]
            for function, arguments in asked:
                assert pool.submit(function, *arguments).result() == function(*arguments)


@pytest.mark.parametrize("name", ["pipe.py:L", "pipe.py"])
def test_a_pipe_is_not_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / "pipe.py")
    with pytest.raises(InputError, match="is a named pipe"):
        localizers.parameters(registry.complete(str(tmp_path / name)))
