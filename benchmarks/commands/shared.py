"""What commands share: arguments, warnings, and the setting of ``paper`` and ``run``."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.sweeps.design import Sweep


class TakesOptions(Protocol):
    """What options are added to: a parser, or a group of its options."""

    @property
    def add_argument(self) -> Any:
        """Add one."""


def folder(text: str) -> Path:
    """Return the folder of an argument; "" would be the current one."""
    return _path(text, "a folder, as in results/mine")


def file(text: str) -> Path:
    """Return the file of an argument; "" would be the current folder."""
    return _path(text, "a file")


def _path(text: str, what: str) -> Path:
    from deqmcl_gym.files import is_possible

    if not text.strip():
        raise argparse.ArgumentTypeError(f"it is empty: name {what}")
    if not is_possible(Path(text)):
        raise argparse.ArgumentTypeError("it has a name of more than 255 bytes: give a shorter one")
    return Path(text)


def add_set(
    parser: TakesOptions,
    example: str = "params.mcl.particles=500",
    names: str = "world.…, assumed.…, params.… and others, docs/sweeps.md",
) -> None:
    """Add single values by the names that a sweep file has; of these the command takes some."""
    help_ = f"a value by its name in a sweep file, as {example}: {names} (one --set each)"
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help=help_)


def add_jobs(parser: TakesOptions, what: str = "trials") -> None:
    """Add how many processes there are."""
    help_ = f"{what} at a time (one per processor)"
    parser.add_argument("--jobs", type=int, metavar="J", help=help_)


def add_timeout(parser: TakesOptions, what: str = "trial") -> None:
    """Add the time limit of each."""
    help_ = f"seconds allowed per {what} (no limit; for a plug-in 3600)"
    parser.add_argument("--timeout", type=float, metavar="S", help=help_)


def share(text: str) -> float:
    """Return 5% or 0.05 as a number."""
    given, percent, _ = text.strip().partition("%")
    try:
        return float(given) / 100 if percent else float(given)
    except ValueError:
        raise argparse.ArgumentTypeError(f"it is {text!r}: give a share, as 5% or 0.05") from None


def add_share(parser: TakesOptions) -> None:
    """Add how many trials are run again."""
    help_ = "share of trials to run again, beside one of each setting and method (1%%)"
    parser.add_argument("--share", type=share, metavar="S", help=help_)


def share_verified(options: argparse.Namespace) -> float:
    """Return that share."""
    from benchmarks.sweeps.verifying import SAMPLED
    from deqmcl_gym.validation import number

    return SAMPLED if options.share is None else number("--share", options.share, low=0, high=1)


def add_seed(parser: TakesOptions, default: int | None = 0) -> None:
    """Add the root seed; None: that of the sweep."""
    help_ = f"root of all randomness ({_else(default)})"
    parser.add_argument("--seed", type=int, default=default, metavar="S", help=help_)


def add_trials(parser: TakesOptions, default: int | None = None) -> None:
    """Add the number of worlds; None: that of the sweep."""
    help_ = f"worlds of each setting ({_else(default)})"
    parser.add_argument("--trials", type=int, default=default, metavar="K", help=help_)


def _else(default: int | None) -> str:
    return "as in the sweep" if default is None else str(default)


def add_out(
    parser: TakesOptions, default: str | None = None, *, without: str | None = None
) -> None:
    """Add the output folder, which must be given if there is neither a default nor one ``without``.

    The latter is told, and left to the command, which finds None.
    """
    usual = default or without
    words = "output folder" if usual is None else f"output folder ({usual})"
    parser.add_argument(
        "--out", type=folder, metavar="DIR", default=default, required=usual is None, help=words
    )


def add_mcap(parser: TakesOptions) -> None:
    """Add the file for Foxglove."""
    help_ = "also write what is believed, for Foxglove and Lichtblick (needs the extra view)"
    parser.add_argument("--mcap", type=file, metavar="FILE.mcap", help=help_)


def mcap_of(options: argparse.Namespace) -> Path | None:
    """Return the absolute path of the file for Foxglove, if one is asked for."""
    from benchmarks.pictures.messages import check_file

    if options.mcap is None:
        return None
    check_file(options.mcap)
    path: Path = options.mcap.absolute()
    return path


def add_setting(parser: TakesOptions) -> None:
    """Add the scenario, the root seed, and the parameters that most localizers have."""
    add = parser.add_argument
    add("--scenario", default="paper", metavar="NAME",
        help="a name (deqmcl list), room.toml or file.py:NAME (paper)")  # fmt: skip
    add_seed(parser)
    add("--particles", type=int, default=1000, metavar="N", help="particles (1000)")
    add("--lag", type=int, default=20, metavar="L", help="lag of the queue (20)")


def setting_sweep(
    options: argparse.Namespace, localizers: Sequence[str], trials: int = 1
) -> "Sweep":
    """Return the localizers on the worlds of the setting, with what is set."""
    from benchmarks.setup.documents import settings
    from benchmarks.sweeps.suites import paper_sweep
    from benchmarks.sweeps.sweepfile import with_settings
    from deqmcl_gym.validation import integer

    refuse_twice(localizers)
    sweep = paper_sweep(
        localizers=localizers,
        scenario=options.scenario,
        trials=integer("--trials", trials, low=1, high=100_000),
        seed=integer("--seed", options.seed),
        lag=integer("--lag", options.lag),
        particles=integer("--particles", options.particles, low=1),
    )
    return with_settings(sweep, settings(options.set))


def refuse_twice(localizers: Sequence[str]) -> None:
    """Refuse no localizer, an unknown one, and one that is named twice."""
    from deqmcl_gym.validation import InputError
    from localizers import names, parameters

    if not localizers:
        raise InputError(f"no localizer is named: allowed values: {', '.join(names())}.")
    for name in localizers:
        parameters(name)
    if len(set(localizers)) < len(localizers):
        raise InputError(f"a localizer is named twice in {', '.join(localizers)}.")


def localizers_named(listed: str) -> tuple[str, ...]:
    """Return the names in ``a,b,c``, without blanks; ``file.py`` is its only localizer."""
    from localizers.registry import LOCALIZER

    return tuple(LOCALIZER.complete(name) for part in listed.split(",") if (name := part.strip()))
