"""Folders of files of ours: nothing of others is overwritten, and one writes at a time."""

from benchmarks.files.inventory import (
    as_written,
    is_empty,
    own_folder,
    own_subfolder,
    refuse_changed,
    write_part,
    written,
)

__all__ = [
    "as_written",
    "is_empty",
    "own_folder",
    "own_subfolder",
    "refuse_changed",
    "write_part",
    "written",
]
