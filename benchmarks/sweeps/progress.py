"""The progress of a sweep while it runs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tqdm import tqdm

from benchmarks.console import doing


@contextmanager
def counted(
    out: Path, total: int, waiting: int, *, shown: bool = True
) -> Iterator[Callable[[bool], None]]:
    """Show a bar on a terminal, elsewhere a line; give the function to call after each trial.

    Args:
        out: folder of the sweep; its name is shown.
        total: trials of the sweep.
        waiting: those that are still to be run.
        shown: False shows nothing.

    Yields:
        A function of whether the trial failed.
    """
    name = out.resolve().name
    failed = 0
    with tqdm(
        desc=name,
        total=total,
        initial=total - waiting,
        unit="trial",
        disable=None if shown else True,
    ) as bar:

        def count(failure: bool) -> None:
            nonlocal failed
            failed += failure
            bar.set_postfix_str(f"{failed} failed" if failed else "", refresh=False)
            bar.update()

        if bar.disable and shown:
            with doing(f"{name}: running {waiting:,} trial{'s' * (waiting != 1)}"):
                yield count
        else:
            bar.set_postfix_str("starting; kernels are compiled at first use")
            yield count
