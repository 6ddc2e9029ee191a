"""Logs: recordings of robots, read from several formats into one form.

>>> from deqmcl_gym import logs
>>> log = logs.read("robot.log.gz", reference="robot.tum")
"""

from deqmcl_gym.logs.log import Log, Record, Scanner
from deqmcl_gym.logs.reading import check_writable, read, write
from deqmcl_gym.logs.trajectory import Trajectory, read_tum, referenced
from deqmcl_gym.validation import LogWarning

__all__ = [
    "Log", "LogWarning", "Record", "Scanner", "Trajectory", "check_writable", "read", "read_tum",
    "referenced", "write",
]  # fmt: skip
