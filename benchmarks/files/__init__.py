"""Files: read as data, written whole or not at all, and only where they are ours."""

from benchmarks.files.inventory import (
    as_written,
    is_empty,
    own_folder,
    refuse_changed,
    write_part,
    written,
)
from deqmcl_gym.files import (
    UnreadableError,
    command_line,
    content_of,
    is_temporary,
    json_of,
    typed,
    utf8,
    writable_folder,
    write_bytes,
    write_text,
)

__all__ = [
    "UnreadableError",
    "as_written",
    "command_line",
    "content_of",
    "is_empty",
    "is_temporary",
    "json_of",
    "own_folder",
    "refuse_changed",
    "typed",
    "utf8",
    "writable_folder",
    "write_bytes",
    "write_part",
    "write_text",
    "written",
]
