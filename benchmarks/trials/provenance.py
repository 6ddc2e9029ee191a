"""What computed a result: versions and a digest of the code."""

import hashlib
import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from benchmarks.trials.spec import Trial

# Libraries whose arithmetic or random numbers reach the results.
_LIBRARIES = ("numpy", "numba", "pymunk", "gymnasium")
# All that a trial runs: a new table or report makes no result out of date.
_OURS = ("setup", "scenarios", "agents", "trials")
PACKAGES = ("deqmcl_gym", "localizers", *(f"benchmarks.{own}" for own in _OURS))


@dataclass(frozen=True)
class Provenance:
    """Everything but the configuration that a trial's numbers depend on; read, or of what runs.

    Attributes:
        code: see ``code_digest``.
        libraries: versions by name.
        plug_ins: digests by name of localizers and scenarios that are not ours, and of the files
            of worlds.
    """

    code: str
    libraries: Mapping[str, str]
    plug_ins: Mapping[str, str]

    def key(self, trial: Trial) -> str:
        """Return the name under which a trial's result is kept."""
        names = (trial.localizer, trial.scenario, *trial.files)
        used = [self.plug_ins.get(name, "") for name in names]
        return trial.key("".join([self._shared, *used]))

    @cached_property
    def _shared(self) -> str:
        words = f"{self.code} {sorted(self.libraries.items())}"
        return hashlib.sha256(words.encode()).hexdigest()


@cache
def code_digest() -> str:
    """Return a digest of the source that a trial's numbers depend on."""
    return hashlib.sha256("".join(map(source_of, PACKAGES)).encode()).hexdigest()


def source_of(package: str) -> str:
    """Return a digest of all source files of a package, or of a module's."""
    digest = hashlib.sha256()
    for path, name in _files(package):
        digest.update(f"{package}/{name}\0".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _files(package: str) -> list[tuple[Path, str]]:
    """Return the source files of a package or module, with their names in it."""
    spec = find_spec(package)
    origin = Path(str(spec and spec.origin))
    if spec is None or spec.submodule_search_locations is None:
        return [(origin, origin.name)]
    root = origin.parent
    return [(path, path.relative_to(root).as_posix()) for path in sorted(root.rglob("*.py"))]


@cache
def versions() -> dict[str, str]:
    """Return the versions of the libraries that results depend on."""
    return {name: version(name) for name in _LIBRARIES}


def environment() -> dict[str, object]:
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
