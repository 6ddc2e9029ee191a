"""Curves by matplotlib, an optional extra."""

import io
from collections.abc import Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from deqmcl_gym.numerics.types import Floats, Indices
from deqmcl_gym.validation import InputError

if TYPE_CHECKING:  # it may not be installed
    from matplotlib.figure import Figure


def require_plots() -> None:
    """Refuse to go on without matplotlib.

    Raises:
        InputError: naming the pip command.
    """
    if find_spec("matplotlib") is None:
        raise InputError(
            "plots need matplotlib, which is not installed: pip install 'deqmcl-gym[plots]'."
        )


def error_plot(curves: Mapping[str, tuple[Indices, Floats]], title: str, words: str) -> bytes:
    """Return error curves over the state's step as PNG; ``words`` say what error and its unit."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.5), dpi=120, layout="constrained")
    axes = figure.subplots()
    for name, (states, errors) in curves.items():
        color = "orange" if name == "x[t]" else "pink" if "-" in name else "blue"
        axes.plot(states, errors, label=f"belief about {name}", color=f"tab:{color}")
    axes.set(xlabel="step of the state estimated", ylabel=words, title=title, ylim=(0, None))
    axes.grid(alpha=0.3)
    axes.legend()
    return png_of(figure)


def png_of(figure: "Figure", **how: Any) -> bytes:
    """Return a figure as PNG, the same bytes each time; ``how`` is for ``savefig``."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None}, **how)
    return buffer.getvalue()
