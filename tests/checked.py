"""Gymnasium's own checker."""

import warnings

import gymnasium as gym
from gymnasium.utils.env_checker import check_env


def has_nothing_to_say(env: gym.Env, *allowed: str, **options: bool) -> None:
    """Check an env; its Box is in px and rad on purpose, and what says an ``allowed`` text too."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for text in ("we recommend using a symmetric and normalized space", *allowed):
            warnings.filterwarnings("ignore", message=f".*{text}.*")
        check_env(env, **options)
