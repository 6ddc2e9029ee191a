"""Logs: recordings of robots, read from several formats into one form.

>>> from deqmcl_gym import logs
>>> log = logs.read("robot.log.gz", reference="robot.tum")
"""

from typing import TYPE_CHECKING, Any

from deqmcl_gym.logs.log import Log, Record, Scanner
from deqmcl_gym.logs.trajectory import Trajectory, read_tum, referenced
from deqmcl_gym.validation import LogWarning

if TYPE_CHECKING:
    from deqmcl_gym.logs.reading import check_writable, read, write

__all__ = [
    "Log",
    "LogWarning",
    "Record",
    "Scanner",
    "Trajectory",
    "check_writable",
    "read",
    "read_tum",
    "referenced",
    "write",
]


def __getattr__(name: str) -> Any:
    """Load the readers of all formats when a log is read or written, and not with every env."""
    if name not in ("check_writable", "read", "write"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from deqmcl_gym.logs import reading

    return getattr(reading, name)
