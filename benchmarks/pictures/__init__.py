"""Pictures: frames, laps, figures; and the style of all charts, never that of the user."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def styled(style: Any = ()) -> Iterator[None]:
    """Draw with these parameters over matplotlib's defaults, whatever matplotlibrc says."""
    import matplotlib as mpl  # an optional extra

    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from")  # it is drawn as a box
        mpl.rcdefaults()
        mpl.rcParams.update(style)
        yield
