"""A seed that nobody chooses: of what was handed in, and of a public value that came later."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.setup.changes import jsonable
from benchmarks.trials.provenance import Provenance
from deqmcl_gym.validation import InputError

_DIGITS = 13  # hex digits of a seed: below 2**53, which every reader of JSON keeps
_NOT_HANDED_IN = ("title", "seed", "held_out")


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """A public value, and where and when it was published.

    Attributes:
        value: as published, as in "8f3c…".
        origin: its name and date, as in "drand quicknet, round 14600000, 2026-11-24".
    """

    value: str
    origin: str

    def __post_init__(self) -> None:
        for name, given in (("--held-out", self.value), ("--origin", self.origin)):
            text = isinstance(given, str) and given and given.isprintable()
            if not text or given != given.strip():
                raise InputError(
                    f"{name} is {given!r}: give one line of text without blanks at its ends."
                )

    def seed(self, digest: str) -> int:
        """Return the root seed: 13 hex digits of SHA-256(digest, line break, value).

        Args:
            digest: see ``submission``.
        """
        said = hashlib.sha256(f"{digest}\n{self.value}".encode()).hexdigest()
        return int(said[:_DIGITS], 16)

    def json(self) -> dict[str, str]:
        """Return it as JSON-able values."""
        return asdict(self)


def submission(sweep: Mapping[str, Any], made: Provenance) -> str:
    """Return the digest of what is handed in: SHA-256 of code, suite, methods and plug-ins.

    It depends neither on the seed, so that the public run and the held-out run have the same, nor
    on the folder that a plug-in is in.

    Args:
        sweep: ``Sweep.canonical()``.
        made: what its trials run.
    """
    said = {key: value for key, value in sweep.items() if key not in _NOT_HANDED_IN}
    words = json.dumps([made.code, placeless(jsonable(said), made)], sort_keys=True)
    return hashlib.sha256(words.encode()).hexdigest()


def placeless(value: Any, made: Provenance) -> Any:
    """Return JSON-able values with plug-ins named by file name and digest, wherever they are."""
    if isinstance(value, dict):
        return {key: placeless(own, made) for key, own in value.items()}
    if isinstance(value, list):
        return [placeless(own, made) for own in value]
    digest = made.plug_ins.get(value) if isinstance(value, str) else None
    return f"{Path(value).name} {digest}" if digest else value
