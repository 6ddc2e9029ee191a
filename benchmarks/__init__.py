"""The harness: paired trials of localizers in the world, their scores, tables and pictures.

``benchmarks.sweep`` compares localizers, ``benchmarks.run`` watches one, ``benchmarks.replay``
plays a recorded log to some, ``benchmarks.smooth`` makes a reference of one, and
``benchmarks.evaluate`` scores a policy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from benchmarks.evaluation import evaluate
    from benchmarks.experiment import run, sweep
    from benchmarks.robots.replaying import replay
    from benchmarks.robots.smoothing import smooth

__all__ = ["evaluate", "replay", "run", "smooth", "sweep"]
# with all that they need
_MODULES = {"evaluate": "evaluation", "replay": "robots.replaying", "smooth": "robots.smoothing"}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"benchmarks.{_MODULES.get(name, 'experiment')}"), name)
