"""Names, parameters and plug-ins: one resolver for every way to name a localizer; digests."""

import inspect
import os
import sys
from functools import partial
from pathlib import Path
from types import ModuleType

import pytest
from deqmcl_command import python
from refusals import refused
from report_cases import trial_of

import localizers
from benchmarks.trials.stage import attempt, key_of
from deqmcl_gym.validation import InputError
from localizers.digests import UNREAD
from localizers.methods.deq_mcl import mcl
from localizers.registry import LOCALIZER
from localizers.template import MyLocalizer

BUILT_IN = localizers.names()
MALFORMED = (b"[deqmcl.localizers]\nno equals sign\n = pack.good:Mine\n", b"no section\n", b"\xff")
OF_OTHERS = ("other.bin", "table.bin", "other.py", "__pycache__/alone.cpython-311.pyc")
OF_PACKAGE = ("weights.npz", "deep/er/w.bin", "torn.py")


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_built_in_localizer_can_be_made_with_its_defaults_said_or_not(robot, name):
    assert isinstance(localizers.make(name, robot), localizers.Localizer)
    for parameter in localizers.parameters(name):
        given = inspect.signature(localizers.resolve(name)).parameters[parameter]
        localizers.make(name, robot, **{parameter: given.default})


@localizers.registered("mine", MyLocalizer)
def test_a_plug_in_is_made_by_its_name_with_its_parameters(robot):
    assert localizers.names() == (*BUILT_IN, "mine")
    assert localizers.parameters("mine") == ("particles",)
    made = localizers.make("mine", robot, particles=3)
    assert type(made) is MyLocalizer
    assert (made.robot, made.particles) == (robot, 3)
    with pytest.raises(InputError, match="did you mean 'particles'"):
        localizers.make("mine", robot, particels=3)


@localizers.registered("open", lambda robot, **given: MyLocalizer(robot, particles=given["any"]))
def test_a_factory_that_takes_any_parameter_gets_it(robot):
    assert localizers.parameters("open") is None
    assert localizers.make("open", robot, any=7).particles == 7


@localizers.registered("mine", MyLocalizer)
@pytest.mark.parametrize(("name", "words"), [("mcl", "taken"), ("a:b", "colon"), (None, "text")])
def test_a_name_that_is_built_in_or_has_a_colon_is_refused_and_the_first_one_stays(name, words):
    before = [(one, localizers.resolve(one)) for one in localizers.names()]
    with pytest.raises(InputError, match=f"{name!r}.*{words}"):
        localizers.register(name, lambda robot: None)
    assert before == [(one, localizers.resolve(one)) for one in localizers.names()]


def test_a_name_that_is_registered_again_means_the_new_one_which_is_said():
    with localizers.registered("mine", MyLocalizer):
        with localizers.registered("mine", Other):
            with pytest.warns(UserWarning, match="'mine' was registered before"):
                localizers.register("mine", partial(Other, particles=2))
            assert localizers.resolve("mine").func is Other
        assert localizers.resolve("mine") is MyLocalizer
    assert localizers.names() == BUILT_IN


class Other(MyLocalizer):
    """Another one."""


CELL = """
import math
from dataclasses import dataclass
from functools import cache, cached_property

from localizers.template import MyLocalizer

GAIN, TABLE = 1.0, {"a": [1.0, {"x", "y", "z"}]}

@dataclass
class Noise:
    sigma: float = 3.0

class Base(MyLocalizer):
    POWER = 1.0

@cache
def helped(x):
    return (lambda: x * GAIN)() + math.pi + len(TABLE)

class Mine(Base):
    \"\"\"Mine.\"\"\"
    def __init__(self, robot, *, particles=10):
        super().__init__(robot, particles=particles)
    @cached_property
    def noise(self):
        return Noise().sigma if helped(1.0) in {"p", "q", "r"} else 0.0
"""


@pytest.fixture
def notebook(monkeypatch):
    def run(before="", after="", name="Mine"):
        main = ModuleType("__main__")
        monkeypatch.setitem(sys.modules, "__main__", main)
        assert before in CELL
        exec(CELL.replace(before, after), vars(main))
        return vars(main)[name]

    return run


def digest(factory):
    with localizers.registered("cell", factory):
        return localizers.source_digest("cell")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("particles=10", "particles=11"),
        ('"z"', '"w"'),
        ("POWER = 1.0", "POWER = True"),
        ("sigma: float = 3.0", "sigma: float = 4.0"),
        ("class Mine(Base)", "class Mine(MyLocalizer)"),
    ],
)
def test_what_a_cell_defines_has_a_digest_of_all_that_it_uses(notebook, before, after):
    own = digest(notebook())
    assert own == digest(notebook()) == digest(notebook("\n    @cached", "\n\n\n    @cached"))
    assert digest(notebook(before, after)) not in (own, None)
    assert digest(partial(notebook(), particles=3)) != digest(partial(notebook(), particles=4))


def test_the_digest_of_a_cell_is_the_same_in_another_process(notebook):
    lines = ["import localizers", f"exec({CELL!r})"]
    lines += ["localizers.register('cell', Mine)", "print(localizers.source_digest('cell'))"]
    for seed in "12":
        said = python("-c", "\n".join(lines), env=os.environ | {"PYTHONHASHSEED": seed})
        assert said.strip() == digest(notebook())


def test_what_cannot_be_read_is_said_to_be_so(notebook):
    mine = notebook("POWER = 1.0", "POWER = (one for one in 'generator')")
    assert digest(mine) == UNREAD


def test_a_loaded_class_whose_file_was_edited_since_is_not_taken_for_the_edited_one(file):
    factory = localizers.resolve(f"{file}:Mine")
    before = digest(factory)
    text = file.read_text()
    file.write_text(text.replace("gain=1.0", "gain=3.0"))
    old = digest(factory)
    assert len({before, old, digest(localizers.resolve(f"{file}:Mine"))}) == 3


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
    for name in ("mcl", "pack.good:Mine", "never-heard-of"):
        assert localizers.absolute_name(name) == name


def test_an_entry_point_is_listed_last_and_loaded_only_when_used(robot, module, install):
    install("theirs = pack.good:Mine\nbroken = pack.raises:Mine [extra]\nmcl = pack.good:Mine")
    assert localizers.names()[-2:] == ("broken", "theirs")
    assert not [name for name in sys.modules if name.partition(".")[0] == "pack"]
    assert type(localizers.make("theirs", robot)).__name__ == "Mine"
    assert "pack.raises" not in sys.modules
    assert localizers.resolve("mcl") is mcl  # the built-in one goes first
    with refused("broken", "its own code raised ArithmeticError: no luck (raises.py, line 2)"):
        localizers.resolve("broken")


@pytest.mark.parametrize("value", ["no_such_pack:Mine", "pack.good", "pack.good:Gone", "::", ":x"])
def test_a_broken_entry_point_breaks_only_its_own_use(module, install, value):
    install(f"broken = {value}")
    assert {"broken", "mcl"} <= set(localizers.names())
    with refused("broken"):
        localizers.resolve("broken")


@pytest.mark.parametrize("text", MALFORMED)
def test_malformed_entry_points_of_one_package_hide_no_other(module, install, tmp_path, text):
    install("theirs = pack.good:Mine")
    install("", "malformed")
    (tmp_path / "site-malformed" / "malformed-1.0.dist-info" / "entry_points.txt").write_bytes(text)
    (tmp_path / "site-malformed" / "nameless.dist-info").mkdir()
    assert localizers.names()[-1] == "theirs"
    localizers.resolve("theirs")


@pytest.mark.parametrize("other", ["", "class Other:\n    pass\n\n", "def _other(robot): ...\n"])
def test_a_file_with_one_localizer_means_that(tmp_path, robot, other):
    file = tmp_path / "one.py"
    template = "from localizers.template import MyLocalizer"
    file.write_text(f"{template}\n{other}\nclass One(MyLocalizer): ...\n")
    assert LOCALIZER.complete(str(file)) == f"{file}:One"
    assert type(localizers.make(str(file), robot)).__name__ == "One"
    for name in ("mcl", "pack.good:Mine", f"{file}:One", "never-heard-of"):
        assert LOCALIZER.complete(name) == name


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("dec-mcl", ["did you mean 'deq-mcl'?", "package.module:NAME", "path/to/file.py:NAME"]),
        ("no_such_pack:Mine", ["No module named 'no_such_pack': install it", "PYTHONPATH"]),
        ("pack.good:Mien", ["pack.good has no 'Mien' (did you mean 'Mine'?)", "OnlyRobot"]),
        ("pack.good:number", ["is of type int", "must be a class or a function for NAME(robot"]),
        ("pack.good:Mine()", ["must be package.module:NAME"]),
        ("pack/goood.py:Mine", ["No such file", "(did you mean 'good.py'?)"]),
        ("./:Mine", ["is a folder"]),
        ("pipe.py:Mine", ["is a named pipe"]),
        ("pack/good.py", ["has Mine, OnlyRobot, NoRobot", "as in pack/good.py:Mine"]),
    ],
)
def test_what_cannot_be_resolved_is_said_in_one_sentence(module, name, words):
    os.mkfifo("pipe.py")
    with refused(name, *words):
        localizers.resolve(name)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def (:\n", "(bad.py, line 1)."),
        ("x = '\0'\n", "null"),
        ("import absent\n", "No module named 'absent' (bad.py, line 1): install it"),
        ("\n\nx = 1 / 0\n", "ZeroDivisionError: division by zero (bad.py, line 3)."),
        ("def __getattr__(name):\n    1 / 0\n", "ZeroDivisionError: division by zero (bad.py"),
        ("", "has no 'Mine'; it defines nothing."),
        ("from localizers import PoseBelief\ndef mines(robot): ...", "defines mines."),
    ],
)
def test_bad_code_is_said_in_one_sentence_and_a_file_is_read_again_when_mended(module, text, words):
    (module / "bad.py").write_text(text)
    for name in ("pack.bad:Mine", "pack/bad.py:Mine"):
        with refused(name, words):
            localizers.resolve(name)
    (module / "bad.py").write_text((module / "good.py").read_text())
    localizers.resolve("pack/bad.py:Mine")


@pytest.mark.parametrize(
    ("attribute", "words"),
    [
        ("NoUpdate", "is of type NoUpdate, without update: one has reset(prior, plan, rng) and"),
        ("none", "is of type NoneType, without reset and update"),
        ("refuses", r"its own code raised ValueError: not this robot (mine.py, line "),
        ("NoRobot", "cannot be made by NAME(robot, **params): its own code raised TypeError"),
    ],
)
def test_what_is_no_localizer_is_refused_when_it_is_made(robot, file, attribute, words):
    with refused(f"{file}:{attribute}", words):
        localizers.make(f"{file}:{attribute}", robot)


def test_the_digest_of_a_file_changes_with_its_text_alone_wherever_it_lies(file, tmp_path):
    before = localizers.source_digest(f"{file}:Mine")
    (tmp_path / "elsewhere").mkdir()
    elsewhere = file.rename(tmp_path / "elsewhere" / file.name)
    (tmp_path / "elsewhere" / "other.py").write_text("x = 1")
    assert localizers.source_digest(f"{elsewhere}:Mine") == before
    elsewhere.write_text(elsewhere.read_text() + "\n")
    assert localizers.source_digest(f"{elsewhere}:Mine") != before


def test_the_digest_runs_nothing_and_what_cannot_be_imported_has_one(module, install):
    install("theirs = pack.good:Mine")
    expected = localizers.source_digest("pack.good:Mine")
    for name in ("theirs", "pack.raises:Mine", "pack.torn:Mine", "pack.gone:Mine"):
        assert localizers.source_digest(name) == expected
    assert localizers.source_digest("pack/torn.py:Mine") is not None
    for name in ("no_such_pack:Mine", "no_such_file.py:Mine", ":", "..:Mine", *BUILT_IN):
        assert localizers.source_digest(name) is None
    assert not [name for name in sys.modules if name.partition(".")[0] == "pack"]


@pytest.mark.parametrize(
    ("name", "shipped", "covered"),
    [
        ("alone.py:Mine", "alone.npz", True),
        *(("alone.py:Mine", file, False) for file in OF_OTHERS),
        *(("pack.good:Mine", f"pack/{file}", True) for file in OF_PACKAGE),
        ("pack.good:Mine", "pack/__pycache__/good.cpython-311.pyc", False),
    ],
)
def test_the_digest_covers_a_package_and_what_has_a_files_name(module, name, shipped, covered):
    Path("alone.py").write_text("class Mine: ...")
    Path(shipped).parent.mkdir(exist_ok=True, parents=True)
    digests = []
    for content in (b"weights", b"other weights", None):
        Path(shipped).unlink() if content is None else Path(shipped).write_bytes(content)
        digests.append(localizers.source_digest(name))
    assert len(set(digests)) == (3 if covered else 1)


STARTING = """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from localizers.template import MyLocalizer

def double(x):
    return 2 * x

class Mine(MyLocalizer):
    def reset(self, prior, plan, rng):
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as own:
            own.submit(double, 1).result()
        return super().reset(prior, plan, rng)
"""


def test_a_file_whose_own_processes_cannot_import_it_is_told_to_be_a_package(tmp_path):
    (tmp_path / "starts.py").write_text(STARTING)
    trial = trial_of(f"{tmp_path}/starts.py:Mine", 0)
    reason = attempt(trial, key_of(trial)).reason
    assert "so make it a package (starts.py, line" in reason
