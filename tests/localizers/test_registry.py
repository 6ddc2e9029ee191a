"""Names, parameters and plug-ins."""

import inspect

import pytest

import localizers
from deqmcl_gym.validation import InputError
from localizers.template import MyLocalizer

BUILT_IN = localizers.names()


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
@pytest.mark.parametrize(("name", "words"), [("mcl", "taken"), ("mine", "taken"), ("a:b", "colon")])
def test_a_name_that_is_taken_or_has_a_colon_is_refused_and_the_first_one_stays(name, words):
    before = [(one, localizers.resolve(one)) for one in localizers.names()]
    with pytest.raises(InputError, match=f"{name!r}.*{words}"):
        localizers.register(name, lambda robot: None)
    assert before == [(one, localizers.resolve(one)) for one in localizers.names()]


def test_a_name_is_known_in_its_with_block_alone():
    with localizers.registered("mine", MyLocalizer):
        assert localizers.resolve("mine") is MyLocalizer
    assert localizers.names() == BUILT_IN
