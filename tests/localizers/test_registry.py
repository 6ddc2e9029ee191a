"""Names, parameters and plug-ins."""

import inspect

import pytest

import localizers
from deqmcl_gym.validation import InputError
from localizers.naming import registry
from localizers.template import MyLocalizer

BUILT_IN = tuple(registry._FACTORIES)


@pytest.fixture(autouse=True)
def _own_registry(monkeypatch):
    monkeypatch.setattr(registry, "_FACTORIES", dict(registry._FACTORIES))


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_built_in_localizer_can_be_made_with_its_defaults_said_or_not(robot, name):
    assert isinstance(localizers.make(name, robot), localizers.Localizer)
    for parameter in localizers.parameters(name):
        given = inspect.signature(registry._FACTORIES[name]).parameters[parameter]
        localizers.make(name, robot, **{parameter: given.default})


def test_a_plug_in_is_made_by_its_name_with_its_parameters(robot):
    localizers.register("mine", MyLocalizer)
    assert localizers.names() == (*BUILT_IN, "mine")
    assert localizers.parameters("mine") == ("particles",)
    made = localizers.make("mine", robot, particles=3)
    assert type(made) is MyLocalizer
    assert (made.robot, made.particles) == (robot, 3)
    with pytest.raises(InputError, match="did you mean 'particles'"):
        localizers.make("mine", robot, particels=3)


def test_a_factory_that_takes_any_parameter_gets_it(robot):
    localizers.register("open", lambda robot, **given: MyLocalizer(robot, particles=given["any"]))
    assert localizers.parameters("open") is None
    assert localizers.make("open", robot, any=7).particles == 7


@pytest.mark.parametrize(("name", "words"), [("mcl", "taken"), ("mine", "taken"), ("a:b", "colon")])
def test_a_name_that_is_taken_or_has_a_colon_is_refused_and_the_first_one_stays(name, words):
    localizers.register("mine", MyLocalizer)
    before = registry._FACTORIES.copy()
    with pytest.raises(InputError, match=f"{name!r}.*{words}"):
        localizers.register(name, lambda robot: None)
    assert before == registry._FACTORIES
