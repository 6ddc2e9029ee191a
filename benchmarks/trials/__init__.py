"""One trial: what is run, named by all that its numbers depend on: settings, code, libraries.

In the other files: how it is set up, run, watched, measured and scored.
"""

import ast
import hashlib
import json
import platform
import sys
import tomllib
from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.setup.overrides import NOTHING, Named, Overrides, jsonable
from deqmcl_gym import __version__
from deqmcl_gym.validation import InputError

_WORLD, _FILTER, _START = 0, 1, 2  # children of a trial's seed


@dataclass(frozen=True)
class Setting:
    """What trials share that may be compared; see ``Trial``."""

    scenario: str
    world: Overrides
    assumed: Overrides
    disturbance: tuple[Overrides, ...]
    lag: int
    seed: int


@dataclass(frozen=True)
class Method(Named):
    """What is compared: a localizer by name, with its parameters, and who drives (None: usual)."""

    agent: Named | None = None
    label: str = field(default="", compare=False)  # what it is called, if not by these

    @property
    def shown(self) -> str:
        """What a row of runs on a log is called."""
        return self.label or self.name

    @property
    def values(self) -> Overrides:
        """All parameters by name, those of the agent as "agent.…"."""
        params = self.agent.params if self.agent else NOTHING
        return self.params | {f"agent.{name}": value for name, value in params.items()}

    @property
    def reference(self) -> str:
        """The names of localizer and agent."""
        return f"{self.agent.name} with {self.name}" if self.agent else self.name

    def __str__(self) -> str:
        localizer = super().__str__()
        return f"{self.agent} with {localizer}" if self.agent else localizer

    def json(self) -> dict[str, Any]:
        """Return it as JSON-able values, without the agent."""
        return super().json() | ({"label": self.label} if self.label else {})


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One localizer on one lap of one world."""

    scenario: str
    world: Overrides = NOTHING
    assumed: Overrides = NOTHING
    disturbance: tuple[Overrides, ...] = ()  #: wrappers, innermost first, ``{"kind": "kidnap", …}``
    localizer: str
    params: Overrides
    agent: Named | None = None  #: who drives; None is the scenario's agent
    lag: int  #: L, the offsets scored are -L, 0 and L
    seed: int
    trial: int  #: number of the world; trials of the same number are paired
    filter_seed: int = 0  #: which of several runs of the localizer on that world

    def __post_init__(self) -> None:
        changes_of(self)

    @property
    def setting(self) -> Setting:
        """What it shares with the trials that it is compared with."""
        changes = self.world, self.assumed, self.disturbance
        return Setting(self.scenario, *changes, self.lag, self.seed)

    @property
    def method(self) -> Method:
        """What is compared."""
        return Method(self.localizer, self.params, self.agent)

    @property
    def run(self) -> tuple[int, int]:
        """The world and the filter seed."""
        return self.trial, self.filter_seed

    @property
    def offsets(self) -> tuple[int, ...]:
        """Offsets scored, in steps."""
        return (0,) if self.lag == 0 else (0, -self.lag, self.lag)

    @property
    def named(self) -> tuple[str, ...]:
        """All of it that may have a digest: names of plug-ins and scenario, and files."""
        agent = () if self.agent is None else (self.agent.name,)
        kind = self.assumed.get("scan.kind", "")
        scan = (kind,) if ":" in str(kind) else ()
        return (self.localizer, self.scenario, *self.world.files, *agent, *scan)

    @property
    def world_seed(self) -> int:
        """The seed for ``env.reset``: a function of (seed, trial), below 2**53."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(self.trial, _WORLD))
        return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(11))

    @property
    def episode(self) -> "Trial":
        """All of it that an episode depends on if the agent does not look at the belief."""
        # whichever localizer it is
        return replace(self, localizer="dead-reckoning", params=NOTHING, lag=0, filter_seed=0)

    def filter_rng(self) -> np.random.Generator:
        """Return the stream of (seed, trial, filter_seed): all filters start from one cloud."""
        return stream(self.seed, self.trial, _FILTER, self.filter_seed)

    def start_rng(self) -> np.random.Generator:
        """Return the stream of a prior that is drawn: a function of (seed, trial, filter_seed)."""
        return stream(self.seed, self.trial, _START, self.filter_seed)

    def canonical(self) -> dict[str, Any]:
        """Return the trial as JSON-able values in a fixed order; an agent only if it has one."""
        values = {part.name: jsonable(getattr(self, part.name)) for part in fields(self)}
        return {name: value for name, value in values.items() if name != "agent" or value}

    def key(self, provenance: str) -> str:
        """Name of its result: a hash of the canonical configuration and of what computes it."""
        text = json.dumps([self.canonical(), provenance], sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:32]


def stream(seed: int, *key: int) -> np.random.Generator:
    """Return the random numbers of a seed and a key."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def changes_of(given: Any) -> None:
    """Let what a trial or a sweep is made of be ``Overrides``, however they were given."""
    for name in ("world", "assumed", "params"):
        object.__setattr__(given, name, Overrides(getattr(given, name)))
    object.__setattr__(given, "disturbance", tuple(map(Overrides, given.disturbance)))


_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
# All that a trial runs: a new table or report makes no result out of date.
PACKAGES = (
    *("deqmcl_gym", "localizers", "benchmarks.setup"),
    *("benchmarks.agents", "benchmarks.policies", "benchmarks.trials"),
)


Environment = dict[str, str | dict[str, str]]


class Provenance(msgspec.Struct, frozen=True, dict=True):
    """Everything but the configuration that a trial's numbers depend on; read, or of what runs."""

    code: str
    libraries: dict[str, str]
    # digests of localizers, scenarios, agents and scan models not ours, and of their files, by name
    plug_ins: dict[str, str] = msgspec.field(name="plug-ins")

    def key(self, trial: Trial) -> str:
        """Return the name under which a trial's result is kept."""
        used = [self.plug_ins.get(name, "") for name in trial.named]
        return trial.key("".join([self._shared, *used]))

    @cached_property
    def _shared(self) -> str:
        text = f"{self.code} {sorted(self.libraries.items())}"
        return hashlib.sha256(text.encode()).hexdigest()


@cache
def code_digest() -> str:
    """Return a digest of the code that a trial's numbers depend on, whatever its words and layout.

    Comments, docstrings and formatting do not count.
    """
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path, name in _files(package):
            digest.update(f"{package}/{name}\0".encode())
            digest.update(_statements(path))
    return digest.hexdigest()


def _files(package: str) -> list[tuple[Path, str]]:
    """Return the source files of a package or module, with their names in it."""
    spec = find_spec(package)
    origin = Path(str(spec and spec.origin))
    paths = [origin]
    if spec is not None and spec.submodule_search_locations is not None:
        paths = sorted([*origin.parent.rglob("*.py"), *origin.parent.rglob("*.toml")])
    if not paths or not all(path.suffix in (".py", ".toml") and path.is_file() for path in paths):
        raise InputError(
            f"results are kept under a digest of the code, but {origin} is no source: unpack "
            "deqmcl-gym with its .py files."
        )
    return [(path, path.relative_to(origin.parent).as_posix()) for path in paths]


def _statements(path: Path) -> bytes:
    """Return the syntax of a source file: each node's type and fields, docstrings left out."""
    if path.suffix == ".toml":
        return repr(tomllib.loads(path.read_text(encoding="utf-8"))).encode()
    tokens: list[str] = []

    def add(value: Any) -> None:
        if isinstance(value, list):
            tokens.append(f"{len(value)}")
            for item in value:
                add(item)
        elif isinstance(value, ast.AST):
            tokens.append(type(value).__name__)
            if isinstance(value, _DOCUMENTED) and ast.get_docstring(value, clean=False) is not None:
                del value.body[0]
            for name in value._fields:
                if (inner := getattr(value, name, None)) is not None and inner != []:
                    tokens.append(name)
                    add(inner)
        else:
            tokens.append(repr(value))

    add(ast.parse(path.read_bytes()))
    return "\0".join(tokens).encode(errors="surrogatepass")


@cache
def versions() -> dict[str, str]:
    """Return the versions of libraries whose arithmetic or random numbers reach the results."""
    return {name: version(name) for name in ("numpy", "numba", "pymunk", "gymnasium")}


def environment() -> Environment:
    """Return what a reader needs to know to get the same numbers."""
    return {
        "deqmcl-gym": __version__,
        "code": code_digest(),
        "python": platform.python_version(),
        "platform": f"{sys.platform} {platform.machine()}",
        "libraries": versions(),
    }
