"""Generate a building from a seed: a ROS map and polygons.

Written are DIR/office.yaml with its image, a ROS map of 0.1 m cells, and DIR/office.json, the same
as polygons. Both can be used as a floor_plan.
"""

import argparse
from pathlib import Path

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
    """Add the command's arguments, those of ``Office``; what is not given is its own default."""
    add = parser.add_argument
    absent = argparse.SUPPRESS
    add("kind", choices=("office",), help="kind of building")
    for name, kind, words in _NUMBERS:
        add(f"--{name}", type=kind, default=absent, metavar="N", help=words)
    for name, words in _SWITCHES:
        add(f"--{name}", action="store_true", default=absent, help=words)
    add("--out", type=shared.folder, required=True, metavar="DIR", help="a new or empty folder")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
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
