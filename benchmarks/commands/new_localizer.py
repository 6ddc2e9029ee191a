"""Write a file with a small working localizer, class MyLocalizer, to start from."""

import argparse
from pathlib import Path
from shlex import quote

from benchmarks.commands import shared


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "file", type=shared.file, metavar="FILE.py", help="the file; must not exist yet"
    )


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from deqmcl_gym.files import write_text
    from deqmcl_gym.validation import InputError

    path: Path = options.file
    if "," in str(path):
        raise InputError(f"the new file is {path}, but --with takes names separated by commas.")
    if path.suffix != ".py":
        raise InputError(f"the new file is {path}, but must end in .py, as in my_localizer.py.")
    if path.exists() or path.is_symlink():
        raise InputError(f"the new file {path} already exists: choose another name.")
    if not path.parent.is_dir():
        raise InputError(f"the folder of the new file {path} does not exist: create it.")
    write_text(path, template())
    name = quote(f"{path if path.is_absolute() else f'./{path}'}:MyLocalizer")
    return (
        f"Written: {path}, a working localizer. Check it and run it:\n"
        f"  deqmcl check {name}\n"
        f"  deqmcl sweep quick --with {name} --out results/mine"
    )


def template() -> str:
    """Return the source of ``localizers.template``."""
    from importlib.util import find_spec

    package = find_spec("localizers")
    assert package is not None, "the packages are installed together"
    assert package.origin is not None, "localizers is no namespace"
    return Path(package.origin).with_name("template.py").read_text(encoding="utf-8")
