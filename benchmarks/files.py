"""The folder that a command writes to."""

from collections.abc import Mapping
from pathlib import Path

from deqmcl_gym.files import is_temporary, writable_folder, write_bytes
from deqmcl_gym.validation import InputError


def is_empty(folder: Path) -> bool:
    """Whether a folder is missing, or holds nothing but what a killed process of ours leaves."""

    def is_begun(path: Path) -> bool:
        return path.match("trials*.jsonl") and path.is_file() and path.stat().st_size == 0

    try:
        return all(is_temporary(path) or is_begun(path) for path in folder.iterdir())
    except FileNotFoundError:
        return True
    except OSError:  # a file, or not to be read: reported when it is written to
        return not folder.is_dir()


def own_folder(folder: Path, *names: str) -> Path:
    """Make a folder for the files of a command, or take one that has one of its files already."""
    taken = (folder / "manifest.json").exists()  # by a sweep
    if not is_empty(folder) and (taken or not any((folder / name).exists() for name in names)):
        raise InputError(
            f"the output folder {folder} holds files, but none of this command's: give a new or "
            "an empty one."
        )
    return writable_folder(folder)


def write_files(folder: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write files by name, over those of before, each whole or not at all; return their paths."""
    for name, content in contents.items():
        write_bytes(folder / name, content)
    for path in {(folder / name).parent for name in contents}:
        for left in filter(is_temporary, path.glob(".*")):  # of a process that was killed
            left.unlink(missing_ok=True)
    return [folder / name for name in contents]
