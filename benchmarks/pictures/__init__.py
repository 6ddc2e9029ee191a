"""Pictures: frames, laps, figures; and the style of all charts, never that of the user."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_OTHER_SCRIPTS = (  # fonts on Linux, macOS and Windows
    "Noto Sans CJK SC", "Noto Sans CJK JP", "WenQuanYi Zen Hei",
    "PingFang SC", "Hiragino Sans", "Microsoft YaHei", "Yu Gothic", "Malgun Gothic",
)  # fmt: skip


@contextmanager
def styled(style: Any = ()) -> Iterator[None]:
    """Draw with these parameters over matplotlib's defaults, whatever matplotlibrc says."""
    import matplotlib as mpl  # an optional extra

    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from")  # it is drawn as a box
        mpl.rcdefaults()
        mpl.rcParams["font.sans-serif"] = fonts()
        mpl.rcParams.update(style)
        yield


def fonts() -> list[str]:
    """DejaVu Sans and, for letters that it lacks, fonts that are installed here."""
    from matplotlib.font_manager import fontManager

    installed = {font.name for font in fontManager.ttflist}
    return ["DejaVu Sans", *(name for name in _OTHER_SCRIPTS if name in installed)]
