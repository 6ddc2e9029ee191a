"""The figures of a folder, drawn once: a record beside them says from what."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from benchmarks.files import write_text
from benchmarks.pictures.figures import write_figures
from benchmarks.trials.plugins import key_of
from benchmarks.trials.provenance import source_of
from benchmarks.trials.spec import Trial

RECORD = "drawn.json"


@dataclass(frozen=True)
class Gallery:
    """The figures of some methods, each given by its trial 0, in a folder.

    Attributes:
        trials: what is shown.
        folder: where; nothing else of ours stands there.
    """

    trials: Sequence[Trial]
    folder: Path

    @property
    def files(self) -> list[Path]:
        """The figures last drawn."""
        return [self.folder / name for name in self._record()["sha256"]]

    def current(self) -> bool:
        """Whether all figures are there, as this code draws them of these trials."""
        record = self._record()
        return bool(record["source"] == self._source()) and all(
            _digest(self.folder / name) == digest for name, digest in record["sha256"].items()
        )

    def draw(self) -> None:
        """Draw the figures; those drawn earlier that are not among them go."""
        earlier = set(self.files)
        written = write_figures(self.trials, self.folder)
        for path in earlier.difference(written):
            path.unlink(missing_ok=True)
        digests = {path.name: _digest(path) for path in written}
        record = {"source": self._source(), "sha256": digests}
        write_text(self.folder / RECORD, json.dumps(record, indent=2) + "\n")

    def _record(self) -> dict[str, Any]:
        try:
            record = json.loads((self.folder / RECORD).read_text(encoding="utf-8"))
            digests = {Path(name).name: digest for name, digest in record["sha256"].items()}
            return {"source": record["source"], "sha256": digests}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):  # none, or not ours
            return {"source": "", "sha256": {}}

    def _source(self) -> str:
        """Name what is drawn, and what draws; "" if that is nothing."""
        if not self.trials:
            return ""
        parts = [*map(key_of, self.trials), source_of("benchmarks"), cv2.__version__]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
