"""Files: read as data, written whole or not at all, and only where they are ours."""

from benchmarks.files.record import is_empty, own_folder, refuse_changed, write_part, written
from deqmcl_gym.files import (
    UnreadableError,
    command_line,
    content_of,
    is_temporary,
    json_of,
    misfit,
    utf8,
    writable_folder,
    write_bytes,
    write_text,
)

__all__ = [
    "UnreadableError",
    "command_line",
    "content_of",
    "is_empty",
    "is_temporary",
    "json_of",
    "misfit",
    "own_folder",
    "refuse_changed",
    "utf8",
    "writable_folder",
    "write_bytes",
    "write_part",
    "write_text",
    "written",
]
