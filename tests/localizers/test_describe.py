"""What a localizer is and takes, in words, for a shell, a notebook and the pages."""

import inspect
from functools import partial
from typing import Annotated

import pytest

import localizers
from benchmarks.cli import main
from deqmcl_gym.validation import InputError

SOURCE = '''
from __future__ import annotations
from typing import Annotated
class Own:
    """Stand still."""
    def __init__(self, robot, a: Annotated[int, "at least 1"] = 3, *, b=0.5, c, **others): ...
    def reset(self, prior, plan, rng): ...
    def update(self, ranges, action, plan): ...
'''


@pytest.mark.parametrize("name", localizers.registry.LOCALIZER.builtin)
def test_every_parameter_of_a_built_in_localizer_has_words(name):
    described = localizers.describe(name)
    assert described.sentence
    assert [one.name for one in described.parameters] == list(localizers.parameters(name))
    assert all(one.meaning for one in described.parameters)
    signature = inspect.signature(localizers.resolve(name)).parameters
    assert all(signature[p.name].default == p.default for p in described.parameters)


def test_a_plug_in_is_described_by_its_annotations_and_the_first_line_of_its_docstring(tmp_path):
    (tmp_path / "own.py").write_text(SOURCE)
    described = localizers.describe(f"{tmp_path}/own.py")
    assert described.sentence == "Stand still."
    required = ("c", inspect.Parameter.empty, "")
    assert described.parameters == (("a", 3, "at least 1"), ("b", 0.5, ""), required)
    assert "  c  required" in repr(described).splitlines()


def test_a_class_and_a_partial_are_described_without_a_name():
    class Bare:
        def __init__(self, robot, speed: Annotated[float, "m/s"] = 1.0):
            pass

    described = localizers.describe(partial(Bare, speed=2.0))
    assert described.sentence == ""
    assert described.parameters == (("speed", 2.0, "m/s"),)
    assert str(localizers.describe(Bare)).startswith("Bare\n")


def test_the_command_prints_a_localizer_or_names_the_nearest(capsys):
    assert main(["list", "mcl"]) == 0
    assert str(localizers.describe("mcl")) in capsys.readouterr().out
    assert main(["list", "suits"]) == 2
    assert "did you mean 'suites'" in capsys.readouterr().err
    with pytest.raises(InputError, match="did you mean 'mcl'"):
        localizers.describe("mlc")
