"""The harness: paired trials of localizers in the world, their scores, tables and pictures.

``benchmarks.sweep`` compares localizers, ``benchmarks.run`` watches one, and ``benchmarks.replay``
plays a recorded log to some.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from benchmarks.experiment import run, sweep
    from benchmarks.robots.replaying import replay

__all__ = ["replay", "run", "sweep"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "replay":
        from benchmarks.robots.replaying import replay

        return replay
    from benchmarks import experiment  # loads all that trials and reports need

    return getattr(experiment, name)
