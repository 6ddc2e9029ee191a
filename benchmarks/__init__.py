"""The harness: paired trials of localizers in the world, their scores, tables and pictures.

``benchmarks.sweep`` compares localizers, ``benchmarks.run`` watches one, ``benchmarks.replay``
plays a recorded log to some, and ``benchmarks.evaluate`` scores a policy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from benchmarks.evaluation import evaluate
    from benchmarks.experiment import run, sweep
    from benchmarks.robots.replaying import replay

__all__ = ["evaluate", "replay", "run", "sweep"]
_MODULES = {"evaluate": "evaluation", "replay": "robots.replaying"}  # load all that they need


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"benchmarks.{_MODULES.get(name, 'experiment')}"), name)
