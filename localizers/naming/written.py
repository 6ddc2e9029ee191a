"""The localizers that a Python file holds, read from its text: no code of it is run."""

import ast
from pathlib import Path

from deqmcl_gym.validation import InputError


def is_file(name: str) -> bool:
    """Whether a name is that of a Python file, without the name of anything in it."""
    return name.endswith(".py")


def localizers_in(file: str) -> list[str]:
    """Return the names of the public classes in a file that have ``reset`` and ``update``.

    Raises:
        InputError: the file cannot be read, or is no Python.
    """
    try:
        tree = ast.parse(Path(file).expanduser().read_bytes(), file)
    except OSError as error:
        raise InputError(f"the file {file} cannot be read: {error.strerror}.") from None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # ValueError: a NUL
        raise InputError(f"the file {file} cannot be parsed as Python: {error}.") from None
    return [
        node.name
        for node in tree.body
        if isinstance(node, ast.ClassDef)
        and not node.name.startswith("_")
        and {"reset", "update"} <= _methods(node)
    ]


def _methods(node: ast.ClassDef) -> set[str]:
    return {own.name for own in node.body if isinstance(own, ast.FunctionDef)}
