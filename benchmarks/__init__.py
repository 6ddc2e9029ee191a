"""The harness: paired trials of localizers in the world, their scores, tables and pictures.

``benchmarks.sweep`` compares localizers, ``benchmarks.run`` watches one.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from benchmarks.experiment import sweep
    from benchmarks.watching import run

__all__ = ["run", "sweep"]


def __getattr__(name: str) -> Any:
    """Load what trials and reports need when it is asked for."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(
        import_module(f"benchmarks.{'watching' if name == 'run' else 'experiment'}"), name
    )
