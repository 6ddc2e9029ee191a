"""Write something to start from: a small working localizer, or a generated building as a map."""

import argparse
from pathlib import Path
from shlex import quote

from benchmarks.commands import shared

_NUMBERS = (
    ("seed", int, "seed of the building (0)"),
    ("wings", int, "wings side by side, 1 to 8, each 16 to 24 m long (2)"),
    ("corridors", int, "corridors through all wings, 1 to 6 (2)"),
    ("corridor", float, "width of all corridors, m (2.0)"),
    ("door", float, "width of all doors, m (0.9)"),
)
_SWITCHES = (
    ("repeated", "make all wings identical"),
    ("symmetric", "make the building the same after a half turn"),
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments; of a map those of ``Office``, each its own default."""
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="localizer|map")
    words = "a file with a small working localizer, class MyLocalizer"
    localizer = kinds.add_parser("localizer", allow_abbrev=False, help=words)
    localizer.add_argument(
        "file", type=shared.file, metavar="FILE.py", help="the file; must not exist yet"
    )
    words = "an office from a seed: a ROS map of 0.1 m cells, and the same as polygons"
    office = kinds.add_parser("map", allow_abbrev=False, help=words, description=f"Write {words}.")
    for name, kind, words in _NUMBERS:
        office.add_argument(
            f"--{name}", type=kind, default=argparse.SUPPRESS, metavar="N", help=words
        )
    for name, words in _SWITCHES:
        office.add_argument(f"--{name}", action="store_true", default=argparse.SUPPRESS, help=words)
    office.add_argument(
        "--out", type=shared.folder, required=True, metavar="DIR", help="a new or empty folder"
    )


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    return _map(options) if options.kind == "map" else _localizer(options.file)


def _localizer(path: Path) -> str:
    from deqmcl_gym.files import write_text
    from deqmcl_gym.validation import InputError

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


def _map(options: argparse.Namespace) -> str:
    from tempfile import TemporaryDirectory

    from deqmcl_gym.files import writable_folder, write_text
    from deqmcl_gym.maps import Office, polygon_map
    from deqmcl_gym.validation import InputError

    said = vars(options)
    office = Office(**{name: said[name] for name, *_ in (*_NUMBERS, *_SWITCHES) if name in said})
    out: Path = options.out
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"the output folder {out} is not empty: give a new or an empty one.")
    with TemporaryDirectory(dir=writable_folder(out)) as folder:
        unfinished = Path(folder)
        office.grid.save(unfinished / "office.yaml")
        write_text(unfinished / "office.json", polygon_map.polygons_text(office.polygons))
        for path in unfinished.iterdir():
            path.replace(out / path.name)
    _, _, width, height = office.grid.bounds
    return (
        f"Written to {out}: an office of {width:.1f} x {height:.1f} m, as office.yaml with "
        f'office.pgm and as office.json. Drive in it: floor_plan = "{out / "office.yaml"}".'
    )
