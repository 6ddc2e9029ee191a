"""Localizers by name, how one is made, and what it takes; scan models of other people's code."""

import contextlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.numerics import Floats, Singles
from deqmcl_gym.validation import number, shown
from localizers.api import Localizer
from localizers.kinds import Kind, absolute_name, raised
from localizers.methods.amcl import amcl
from localizers.methods.cbgl import cbgl
from localizers.methods.classical import DeadReckoning, ekf
from localizers.methods.deq_mcl import (
    deq_mcl,
    deq_mcl_fresh,
    mcl,
    mcl_map,
    mcl_map_smoother,
    mcl_plan,
    mcl_plan_hedged,
    mcl_smoother,
)
from localizers.methods.grid import grid
from localizers.models import RobotModel
from localizers.models.scan import Scan, ScanModel, in_blocks

Factory = Callable[..., Localizer]

LOCALIZER = Kind(
    word="localizer",
    call="NAME(robot, **params)",
    verbs={"reset": "prior, plan, rng", "update": "ranges, action, plan"},
    group="deqmcl.localizers",
    builtin={
        "mcl": mcl,
        "mcl-smoother": mcl_smoother,
        "mcl-map": mcl_map,
        "mcl-map-smoother": mcl_map_smoother,
        "deq-mcl": deq_mcl,
        "deq-mcl-fresh": deq_mcl_fresh,
        "mcl-plan": mcl_plan,
        "mcl-plan-hedged": mcl_plan_hedged,
        "dead-reckoning": DeadReckoning,
        "grid": grid,
        "amcl": amcl,
        "cbgl": cbgl,
        "ekf": ekf,
    },
    gone={
        "mcl-h": "use deq-mcl-fresh, which has its error.",
        "mcl-pilots": "use deq-mcl-fresh, which has its numbers.",
        "deq-mcl-rejuvenated": "use deq-mcl-fresh.",
    },
)
names, parameters, register = LOCALIZER.names, LOCALIZER.parameters, LOCALIZER.register
registered = LOCALIZER.registered
resolve: Callable[[str], Factory] = LOCALIZER.resolve


def make(name: str, robot: RobotModel, **params: Any) -> Localizer:
    """Make the localizer of a name, see ``localizers.kinds``, with its ``parameters(name)``.

    An unknown name or parameter, a bad value, or a plug-in that fails or makes something without
    ``reset`` or ``update`` raises ``InputError``.
    """
    made: Localizer = LOCALIZER.make(name, params, robot)
    return made


def source_digest(name: str) -> str | None:
    """Digest of a plug-in, see ``Kind.digest``; None of a built-in localizer, or of none."""
    return LOCALIZER.digest(name) or None


SCAN_MODEL = Kind(
    word="scan model",
    builtin={},  # those of single beams are ``BEAM_MODELS``
    group="deqmcl.scan_models",
    call="NAME(floor_plan=…, lidar=…, **params)",
    verbs={"log_likelihood": "states, scan"},
)


@dataclass(frozen=True, kw_only=True)
class ScanPlugIn:
    """A scan model by the place of its code, p(o | x, m)^power, with a power in (0, 1].

    ``kind`` is the name, as ``path/to/file.py:NAME``, of what makes a ``ScanModel`` by
    ``NAME(floor_plan=…, lidar=…, **params)``.
    """

    kind: str
    power: float = 1.0
    params: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", absolute_name(SCAN_MODEL.complete(self.kind)))
        number("scan.power", self.power, low=0, high=1, above=True)

    def __str__(self) -> str:
        """Return the name without the folder of its file."""
        return repr(Path(self.kind).name)

    def __getattr__(self, name: str) -> Any:
        """Say what to ask instead of ``robot.scan``, if it is asked about single beams."""
        words = f"{type(self).__name__!r} object has no attribute {name!r}"
        if name in ("log_likelihood", "least_density", "hit_moments"):
            words = (
                f"the scan model {self} tells only of whole scans, so robot.scan has no {name}: "
                "ask robot.scan_model().log_likelihood(states, Scan.of(ranges, max_range)), or "
                "assume a model of single beams"
            )
        raise AttributeError(words)

    def changed(self, **changes: Any) -> Self:
        """Return it with another ``power`` or parameters changed."""
        power = changes.pop("power", self.power)
        return replace(self, power=power, params={**self.params, **changes})

    def made(self, floor_plan: Map, lidar: Lidar) -> "CheckedScan":
        """Return the model of scans by a lidar on a map."""
        model = SCAN_MODEL.make(self.kind, self.params, floor_plan=floor_plan, lidar=lidar)
        return CheckedScan(model, self)


@dataclass(frozen=True)
class CheckedScan:
    """Somebody else's scan model, asked for at most 8192 poses at a time, its values looked at."""

    model: ScanModel
    of: ScanPlugIn

    def log_likelihood(self, states: Singles, scan: Scan) -> Floats:
        """Log-likelihood at each pose (3, n), (n,); 0 of a scan without a usable beam.

        A model that fails, or answers with another shape, NaN or inf, raises ``RuntimeError``.
        """
        if scan.beams == 0:
            return np.zeros(states.shape[1])
        return in_blocks(lambda some: self._asked(some, scan), states)

    def _asked(self, states: Singles, scan: Scan) -> Floats:
        n = states.shape[1]
        try:
            answer = self.model.log_likelihood(np.ascontiguousarray(states), scan)
            logs = np.asarray(answer, np.float64)
        except Exception as error:
            raise RuntimeError(f"the scan model {self.of} raised {raised(error)}.") from error
        if logs.shape != (n,):
            raise RuntimeError(
                f"the scan model {self.of} answered with shape {logs.shape} to {n} poses, but must "
                f"with ({n},)."
            )
        amiss = np.flatnonzero(np.isnan(logs) | (logs == np.inf))
        if amiss.size:
            at = ", ".join(f"{number:.6g}" for number in states[:, amiss[0]].tolist())
            raise RuntimeError(
                f"the scan model {self.of} answered {logs[amiss[0]]} at the pose ({at}), but must "
                "with a finite number or -inf."
            )
        return self.of.power * logs


class ParameterWords(NamedTuple):
    """A parameter of a localizer."""

    name: str
    default: Any  # ``inspect.Parameter.empty`` without one
    meaning: str  # with its range; "" if its author has not said it

    @property
    def default_words(self) -> str:
        """The default as code."""
        return "required" if self.default is inspect.Parameter.empty else shown(self.default)


@dataclass(frozen=True, repr=False)
class Description:
    """What a localizer is, and its parameters; a shell and a notebook show it as a table."""

    name: str
    sentence: str  # first line of its docstring
    parameters: tuple[ParameterWords, ...]

    def __repr__(self) -> str:
        from tabulate import tabulate  # few ask

        head = f"{self.name}: {self.sentence.replace('``', '')}".removesuffix(": ")
        rows = [("", p.name, p.default_words, p.meaning) for p in self.parameters]
        table = tabulate(rows, tablefmt="plain", disable_numparse=True)
        return f"{head}\n\n{table}" if rows else head


def describe(name: str | Callable[..., Any]) -> Description:
    """Say what a localizer is: built in, a plug-in by its name, or a class.

    A parameter's meaning is the text of its annotation, ``Annotated[int, "at least 1"]``.
    """
    factory = resolve(name) if isinstance(name, str) else name
    source = inspect.unwrap(getattr(factory, "func", factory))  # of a partial
    text = inspect.cleandoc(source.__doc__ or "")
    if inspect.isclass(source) and text.startswith(f"{source.__name__}("):
        text = ""  # a dataclass's own
    sentence = text.partition("\n")[0].removeprefix("Return ")
    return Description(
        name if isinstance(name, str) else getattr(name, "__name__", type(name).__name__),
        sentence[:1].upper() + sentence[1:],
        tuple(_parameters_of(factory)),
    )


def _parameters_of(factory: Callable[..., Any]) -> Iterator[ParameterWords]:
    listed: list[inspect.Parameter] = []
    for evaluated in (False, True):  # a plug-in's annotations may name what cannot be found
        with contextlib.suppress(Exception):
            listed = list(inspect.signature(factory, eval_str=evaluated).parameters.values())
    for p in listed[1:]:
        if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD):
            words = (m for m in getattr(p.annotation, "__metadata__", ()) if isinstance(m, str))
            yield ParameterWords(p.name, p.default, "; ".join(words))
