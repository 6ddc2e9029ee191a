"""Laws on randomness: the generator given to reset is the only one."""

import random
from typing import Any

import numpy as np

from localizers.checks.subject import (
    LawBrokenError,
    Subject,
    first_difference,
    require_same,
)


def same_rng_same_result(subject: Subject) -> None:
    """Two new localizers given equal generators believe the same, bit by bit."""
    require_same(subject.history(), subject.history(), "two runs with equal rng differ")


def other_rng_other_result(subject: Subject) -> str | None:
    """Another generator gives another belief; a deterministic localizer draws nothing."""
    if first_difference(subject.history(seed=0), subject.history(seed=1)) is not None:
        return None
    rng = np.random.default_rng(0)
    before = _state(rng)
    subject.history(seed=rng)
    if _state(rng) != before:
        raise LawBrokenError(
            "it draws from rng, yet another rng changes nothing: use only the rng given to reset"
        )
    return "deterministic, it draws nothing"


def global_rng_untouched(subject: Subject) -> None:
    """Neither NumPy's global random state nor that of ``random`` changes."""
    held = np.random.get_state(), random.getstate()  # noqa: NPY002
    try:
        np.random.seed(2_718_281)  # noqa: NPY002
        random.seed(2_718_281)
        before = _global_states()
        subject.history()
        touched = [name for name, state in _global_states().items() if state != before[name]]
    finally:
        np.random.set_state(held[0])  # noqa: NPY002
        random.setstate(held[1])
    if touched:
        raise LawBrokenError(
            f"it uses the global random numbers of {' and '.join(touched)}: use the rng given to "
            "reset"
        )


def _global_states() -> dict[str, Any]:
    legacy: Any = np.random.get_state(legacy=False)  # noqa: NPY002
    numpy_state = legacy["state"]["pos"], legacy["state"]["key"].tobytes(), legacy["has_gauss"]
    return {"numpy.random": numpy_state, "random": random.getstate()}


def _state(rng: np.random.Generator) -> tuple[Any, int]:
    """Draws move the first, spawned children the second."""
    seeds: Any = rng.bit_generator.seed_seq
    return rng.bit_generator.state, seeds.n_children_spawned
