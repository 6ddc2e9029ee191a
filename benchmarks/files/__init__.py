"""Output files: written whole or not at all, and not again while nothing has changed."""

from benchmarks.files.record import written
from benchmarks.files.writing import writable_folder, write_bytes, write_text

__all__ = ["writable_folder", "write_bytes", "write_text", "written"]
