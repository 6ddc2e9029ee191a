"""The progress of many runs while they are made: a bar on a terminal, elsewhere a line a minute."""

import io
import math
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.console import beside, doing

MINUTE = 60.0  # s between two lines
_LINE = "{desc}: {n_fmt} of {total_fmt} done after {elapsed}, {remaining} left{postfix}"


@contextmanager
def counted(
    out: Path, total: int, waiting: int, *, shown: bool = True
) -> Iterator[Callable[[bool], None]]:
    """Show a bar on a terminal, elsewhere a line every minute; give what to call after each trial.

    Args:
        out: folder of the sweep; its name is shown.
        total: trials of the sweep.
        waiting: those that are still to be run.
        shown: False shows nothing.

    Yields:
        A function of whether the trial failed.
    """
    name = out.resolve().name
    failed, lines = 0, shown and not sys.stderr.isatty()
    kept: dict[str, Any] = {"desc": name, "total": total, "initial": total - waiting}
    if lines:  # what tqdm would print goes nowhere; it counts and estimates
        kept |= {"file": io.StringIO(), "mininterval": math.inf, "bar_format": _LINE}
        kept |= {"smoothing": 0.0}
    with tqdm(**kept, unit="trial", disable=not shown) as bar:

        def count(failure: bool) -> None:
            nonlocal failed
            failed += failure
            bar.set_postfix_str(f"{failed} failed" if failed else "", refresh=False)
            bar.update()

        def tell(done: threading.Event) -> None:
            while not done.wait(MINUTE):
                print(f"deqmcl: {bar}", file=sys.stderr, flush=True)

        if lines:
            running = f"{name}: running {waiting:,} trial{'s' * (waiting != 1)}"
            with doing(running), beside(tell):
                yield count
        else:
            bar.set_postfix_str("starting; kernels are compiled at first use")
            yield count
