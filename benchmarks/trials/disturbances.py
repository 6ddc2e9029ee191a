"""Disturbances by name: ``{kind = "kidnap", step = 100}`` of a sweep as a wrapper of the env."""

import inspect
from collections.abc import Iterable
from types import MappingProxyType
from typing import Any

import gymnasium as gym

from benchmarks.trials.spec import Params
from deqmcl_gym.envs.wrappers import BeamDropout, Kidnap, PlanChange
from deqmcl_gym.validation import InputError, one_of

KINDS = MappingProxyType({"kidnap": Kidnap, "dropout": BeamDropout, "plan-change": PlanChange})


def disturbed(env: gym.Env[Any, Any], wrappers: Iterable[Params]) -> gym.Env[Any, Any]:
    """Return ``env`` inside its wrappers, innermost first.

    Raises:
        InputError: unknown kind or argument, or a bad value.
    """
    for wrapper in wrappers:
        arguments = dict(wrapper)
        if "kind" not in arguments:
            raise InputError(
                f"a disturbance has no kind ({arguments}): allowed values: {', '.join(KINDS)}."
            )
        kind = one_of("kind of disturbance", arguments.pop("kind"), KINDS)
        accepted = dict(list(inspect.signature(KINDS[kind]).parameters.items())[1:])
        for name in arguments:
            one_of(f"key of disturbance {kind!r}", name, accepted)
        for name, parameter in accepted.items():
            if parameter.default is parameter.empty and name not in arguments:
                raise InputError(f"the disturbance {kind!r} needs {name}: write {name} = ….")
        env = KINDS[kind](env, **arguments)
    return env
