"""The localizers in a Python file, found by parsing it: its code is not run."""

import ast
from collections.abc import Mapping
from pathlib import Path

from deqmcl_gym.files import UnreadableError, content_of
from deqmcl_gym.validation import InputError


def is_file(name: str) -> bool:
    """Whether a name is that of a Python file, without the name of anything in it."""
    return name.endswith(".py")


def localizers_in(file: str) -> list[str]:
    """Return the names of the public classes in a file that have ``reset`` and ``update``.

    Raises:
        InputError: the file cannot be read, or is not Python.
    """
    try:
        tree = ast.parse(content_of(Path(file).expanduser()), file)
    except FileNotFoundError as error:
        raise InputError(f"the file {file} cannot be read: {error.strerror}.") from None
    except UnreadableError as error:
        raise InputError(f"the file {file} {error}.") from None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # ValueError: a NUL
        raise InputError(f"the file {file} cannot be parsed as Python: {error}.") from None
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    return [
        name
        for name in classes
        if not name.startswith("_") and {"reset", "update"} <= _methods(name, classes)
    ]


def _methods(name: str, classes: Mapping[str, ast.ClassDef]) -> set[str]:
    """Names of the methods of a class, also of those that it inherits from others in the file."""
    if name not in classes:
        return set()
    own, others = classes[name], {key: value for key, value in classes.items() if key != name}
    found = {node.name for node in own.body if isinstance(node, ast.FunctionDef)}
    return found.union(*(_methods(ast.unparse(base), others) for base in own.bases))
