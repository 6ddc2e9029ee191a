"""Colours and marks of methods: the same method looks the same in every picture."""

from collections.abc import Iterable
from dataclasses import dataclass

INK, FAINT = "#010203", "#010204"  # stand for the page's colours until the picture is written


@dataclass(frozen=True)
class Look:
    """Colour by name of a CSS variable, its stand-in in the picture, and a mark."""

    name: str
    color: str
    mark: str


# After Okabe & Ito (2008): told apart under every common colour blindness.
_LOOKS = {
    "mcl": Look("blue", "#0072b2", "o"),
    "mcl-smoother": Look("sky", "#56b4e9", "s"),
    "mcl-map": Look("green", "#009e73", "^"),
    "mcl-map-smoother": Look("amber", "#e69f00", "v"),
    "deq-mcl": Look("red", "#d55e00", "D"),
    "dead-reckoning": Look("gray", "#777777", "X"),
}
_MORE = (
    Look("purple", "#cc79a7", "P"),
    Look("teal", "#117a8b", "*"),
    Look("olive", "#8a7a00", "h"),
    Look("violet", "#6a51a3", "<"),
    Look("brown", "#8c510a", ">"),
    Look("rose", "#b2185d", "p"),
    Look("slate", "#44596e", "d"),
    Look("lime", "#6b9a00", "H"),
    Look("navy", "#1f3b8f", "8"),
)
LIGHT = {look.name: look.color for look in (*_LOOKS.values(), *_MORE)}
DARK = {
    "blue": "#4aa8e0",
    "sky": "#8fd0f7",
    "green": "#2fc79b",
    "amber": "#f5b83d",
    "red": "#ff8a3d",
    "gray": "#a8a8a8",
    "purple": "#e6a3c7",
    "teal": "#4cc3d6",
    "olive": "#d1c04a",
    "violet": "#a994e0",
    "brown": "#d69a5b",
    "rose": "#f277ad",
    "slate": "#9db4cb",
    "lime": "#b5e04a",
    "navy": "#8aa6ff",
}


def looks(labels: Iterable[str]) -> dict[str, Look]:
    """Give each label a look; those that we do not know take what is left, in order."""
    listed = list(dict.fromkeys(labels))
    strangers = [label for label in listed if label not in _LOOKS]
    taken = {label: _MORE[i % len(_MORE)] for i, label in enumerate(strangers)}
    return {label: (_LOOKS | taken)[label] for label in listed}
