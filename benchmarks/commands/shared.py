"""What commands share: arguments, warnings, and the setting of ``paper`` and ``run``."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.sweeps.design import Sweep


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


def add_read(parser: argparse.ArgumentParser) -> None:
    """Add how a log is read."""
    help_ = (
        "how to read the log, as in scan_topic=/front, base_frame=base, max_range=20 (one --read "
        "each)"
    )
    parser.add_argument("--read", action="append", default=[], metavar="NAME=VALUE", help=help_)


def add_jobs(parser: argparse.ArgumentParser, what: str = "trials") -> None:
    """Add how many processes there are."""
    help_ = f"{what} at a time (one per processor)"
    parser.add_argument("--jobs", type=int, metavar="J", help=help_)


def add_timeout(parser: argparse.ArgumentParser, what: str = "trial") -> None:
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


def add_share(parser: argparse.ArgumentParser) -> None:
    """Add how many trials are run again."""
    help_ = "share of trials to run again, beside one of each setting and method (1%%)"
    parser.add_argument("--share", type=share, metavar="S", help=help_)


def share_verified(options: argparse.Namespace) -> float:
    """Return that share."""
    from benchmarks.sweeps.verifying import SAMPLED
    from deqmcl_gym.validation import number

    return SAMPLED if options.share is None else number("--share", options.share, low=0, high=1)


def add_seed(parser: argparse.ArgumentParser, default: int | None = 0) -> None:
    """Add the root seed; None: that of the sweep."""
    help_ = f"root of all randomness ({_else(default)})"
    parser.add_argument("--seed", type=int, default=default, metavar="S", help=help_)


def add_trials(parser: argparse.ArgumentParser, default: int | None = None) -> None:
    """Add the number of worlds; None: that of the sweep."""
    help_ = f"worlds of each setting ({_else(default)})"
    parser.add_argument("--trials", type=int, default=default, metavar="K", help=help_)


def _else(default: int | None) -> str:
    return "as in the sweep" if default is None else str(default)


def add_out(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """Add the output folder, which must be given if there is no default."""
    needed: Any = {"required": True} if default is None else {"default": default}
    words = "output folder" if default is None else f"output folder ({default})"
    parser.add_argument("--out", type=folder, metavar="DIR", help=words, **needed)


def add_mcap(parser: argparse.ArgumentParser) -> None:
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


def add_setting(parser: argparse.ArgumentParser) -> None:
    """Add the scenario, the root seed, and the parameters that most localizers have."""
    add = parser.add_argument
    add("--scenario", default="paper", metavar="NAME",
        help="a name (deqmcl list), room.toml or file.py:NAME (paper)")  # fmt: skip
    add_seed(parser)
    add("--particles", type=int, default=1000, metavar="N", help="particles (1000)")
    add("--lag", type=int, default=20, metavar="L", help="lag of the queue (20)")


def add_params(parser: argparse.ArgumentParser) -> None:
    """Add parameters of single localizers."""
    help_ = "a parameter of a localizer, as in mcl-map.start_draws=20 (one --param each)"
    parser.add_argument(
        "--param", action="append", default=[], metavar="NAME.KEY=VALUE", help=help_
    )


def params_named(words: Sequence[str], localizers: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return NAME.KEY=VALUE words as parameters by localizer; a value is as in a sweep file."""
    from benchmarks.setup.overrides import OF_LOCALIZERS, Overrides
    from benchmarks.sweeps.settings import settings
    from deqmcl_gym.validation import InputError, one_of
    from localizers import absolute_name, parameters
    from localizers.registry import LOCALIZER

    as_given = {absolute_name(name): name for name in localizers}
    found: dict[str, dict[str, Any]] = {}
    form = "NAME.KEY=VALUE, as mcl-map.start_draws=20"
    for place, value in settings("--param", words, form).items():
        given, _, key = place.rpartition(".")
        if not (given and key):
            raise InputError(f"--param has {place!r}, but must be {form}.")
        name = LOCALIZER.complete(given)
        name = as_given.get(absolute_name(name), name)
        one_of("localizer in --param", name, localizers)
        known = parameters(name)
        if known is not None:
            one_of(f"parameter of localizer {name!r} in --param", key, known)
        found.setdefault(name, {})[key] = value
    return {name: dict(Overrides(own).beside(Path(), OF_LOCALIZERS)) for name, own in found.items()}


def setting_sweep(
    options: argparse.Namespace,
    localizers: Sequence[str],
    trials: int = 1,
    own: Mapping[str, Mapping[str, Any]] | None = None,
    agent: str | None = None,
) -> "Sweep":
    """Return the localizers on the worlds of the setting."""
    from benchmarks.setup.overrides import Named, Overrides
    from benchmarks.sweeps.suites import paper_sweep
    from benchmarks.trials.spec import Method
    from deqmcl_gym.validation import InputError, integer
    from localizers import names, parameters

    if not localizers:
        raise InputError(f"no localizer is named: allowed values: {', '.join(names())}.")
    for name in localizers:
        parameters(name)
    if len(set(localizers)) < len(localizers):
        raise InputError(f"a localizer is named twice in {', '.join(localizers)}.")
    sweep = paper_sweep(
        scenario=options.scenario,
        localizers=localizers,
        trials=integer("--trials", trials, low=1, high=100_000),
        seed=integer("--seed", options.seed),
        lag=integer("--lag", options.lag),
        particles=integer("--particles", options.particles, low=1),
    )
    if own:
        methods = (Method(name=name, params=Overrides(own.get(name, {}))) for name in localizers)
        sweep = replace(sweep, localizers=tuple(methods))
    if agent is not None:
        sweep = replace(sweep, agent=Named(agent))
    return sweep


def with_agents(sweep: "Sweep", listed: str | None) -> "Sweep":
    """Return a sweep driven by each of the agents in ``a,b,c`` in turn; None: as it says itself."""
    from benchmarks.setup.overrides import Overrides
    from benchmarks.sweeps.design import Axis
    from deqmcl_gym.validation import InputError

    if listed is None:
        return sweep
    names = tuple(dict.fromkeys(name for part in listed.split(",") if (name := part.strip())))
    if not names:
        raise InputError(
            "--agents names no agent: give one or more, as in --agents stale,misplaced."
        )
    if taken := [name for name in sweep.varied if name.partition(".")[0] == "agent"]:
        raise InputError(f"the sweep varies {taken[0]} itself: leave out --agents.")
    axis = Axis(values=Overrides({"agent": names}))
    baseline = "" if len(names) > 1 else sweep.baseline
    return replace(sweep, agent=None, vary=(*sweep.vary, axis), baseline=baseline)


def with_options(options: argparse.Namespace, sweep: "Sweep") -> "Sweep":
    """Return a sweep with the worlds, the root seed and the parameters that are asked for.

    The method of a limit keeps its own parameters, such as its particles.
    """
    from benchmarks.setup.overrides import Overrides
    from deqmcl_gym.validation import integer

    own = params_named(options.param, list(dict.fromkeys(sweep.names)))
    trials, seed = sweep.trials, sweep.seed
    if options.trials is not None:
        trials = integer("--trials", options.trials, low=1, high=100_000)
    if options.seed is not None:
        seed = integer("--seed", options.seed)
    localizers = tuple(
        replace(method, params=method.params | own.get(method.name, {}))
        for method in sweep.localizers
    )
    limits = []
    for limit in sweep.limits:
        params = Overrides(own.get(limit.method.name, {})) | limit.method.params
        limits.append(replace(limit, method=replace(limit.method, params=params)))
    return replace(sweep, trials=trials, seed=seed, localizers=localizers, limits=tuple(limits))


def localizers_named(listed: str) -> tuple[str, ...]:
    """Return the names in ``a,b,c``, without blanks; ``file.py`` is its only localizer."""
    from localizers.registry import LOCALIZER

    return tuple(LOCALIZER.complete(name) for part in listed.split(",") if (name := part.strip()))
