"""Names that ``benchmarks.execution`` and ``localizers.checks`` still ask for here."""

from localizers.kinds import absolute_name, is_ctrl_c, raised
from localizers.naming.own_process import (
    SAFE_PATH,
    SPAWN,
    EndedError,
    NoAnswerError,
    OwnProcess,
    enter,
    safe_path,
)

__all__ = [
    "SAFE_PATH",
    "SPAWN",
    "EndedError",
    "NoAnswerError",
    "OwnProcess",
    "absolute_name",
    "enter",
    "is_ctrl_c",
    "raised",
    "safe_path",
]
