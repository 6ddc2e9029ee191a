"""Arguments that several commands take."""

import argparse


def add_setting(parser: argparse.ArgumentParser) -> None:
    """Add the root seed, the world, and the parameters that most localizers have."""
    parser.add_argument("--seed", type=int, default=0, help="root of all randomness (0)")
    parser.add_argument(
        "--scenario",
        default="paper",
        help="the world: paper, matched, sharp or guided (paper)",
    )
    parser.add_argument("--particles", type=int, default=1000, metavar="N", help="particles (1000)")
    parser.add_argument("--lag", type=int, default=20, metavar="L", help="lag of the queue (20)")


def comma_separated(listed: str) -> tuple[str, ...]:
    """Return the names in ``a,b,c``, without blanks."""
    return tuple(name for part in listed.split(",") if (name := part.strip()))
