"""What computed a result: versions and a digest of the code."""

import ast
import hashlib
import platform
import sys
import tomllib
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from msgspec import Struct, field

from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError

# Libraries whose arithmetic or random numbers reach the results.
_LIBRARIES = ("numpy", "numba", "pymunk", "gymnasium")
# All that a trial runs: a new table or report makes no result out of date.
_OURS = ("setup", "agents", "policies", "trials")
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
PACKAGES = ("deqmcl_gym", "localizers", *(f"benchmarks.{own}" for own in _OURS))


Environment = dict[str, str | dict[str, str]]


class Provenance(Struct, frozen=True, dict=True):
    """Everything but the configuration that a trial's numbers depend on; read, or of what runs."""

    code: str
    libraries: dict[str, str]
    # digests of localizers, scenarios, agents and scan models not ours, and of their files, by name
    plug_ins: dict[str, str] = field(name="plug-ins")

    def key(self, trial: Trial) -> str:
        """Return the name under which a trial's result is kept."""
        used = [self.plug_ins.get(name, "") for name in trial.named]
        return trial.key("".join([self._shared, *used]))

    @cached_property
    def _shared(self) -> str:
        words = f"{self.code} {sorted(self.libraries.items())}"
        return hashlib.sha256(words.encode()).hexdigest()


@cache
def code_digest() -> str:
    """Return a digest of the code that a trial's numbers depend on, whatever its words and layout.

    Comments, docstrings and formatting do not count.
    """
    digests = map(_digest_of, PACKAGES)
    return hashlib.sha256("".join(digests).encode()).hexdigest()


def _digest_of(package: str) -> str:
    digest = hashlib.sha256()
    for path, name in _files(package):
        digest.update(f"{package}/{name}\0".encode())
        digest.update(_statements(path))
    return digest.hexdigest()


def _files(package: str) -> list[tuple[Path, str]]:
    """Return the source files of a package or module, with their names in it."""
    spec = find_spec(package)
    origin = Path(str(spec and spec.origin))
    module = spec is None or spec.submodule_search_locations is None
    folder = (*origin.parent.rglob("*.py"), *origin.parent.rglob("*.toml"))  # as of scenarios
    paths = [origin] if module else sorted(folder)
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
    words: list[str] = []

    def add(value: Any) -> None:
        if isinstance(value, list):
            words.append(f"{len(value)}")
            for item in value:
                add(item)
        elif isinstance(value, ast.AST):
            words.append(type(value).__name__)
            if isinstance(value, _DOCUMENTED) and ast.get_docstring(value, clean=False) is not None:
                del value.body[0]
            for name in value._fields:
                if (inner := getattr(value, name, None)) is not None and inner != []:
                    words.append(name)
                    add(inner)
        else:
            words.append(repr(value))

    add(ast.parse(path.read_bytes()))
    return "\0".join(words).encode(errors="surrogatepass")


@cache
def versions() -> dict[str, str]:
    """Return the versions of the libraries that results depend on."""
    return {name: version(name) for name in _LIBRARIES}


def environment() -> Environment:
    """Return what a reader needs to know to get the same numbers."""
    try:
        ours = version("deqmcl-gym")
    except PackageNotFoundError:
        ours = "not installed"
    return {
        "deqmcl-gym": ours,
        "code": code_digest(),
        "python": platform.python_version(),
        "platform": f"{sys.platform} {platform.machine()}",
        "libraries": versions(),
    }
