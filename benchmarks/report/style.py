"""Colours and marks of methods: the same method looks the same in every picture."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

INK, FAINT = "#010203", "#010204"  # stand for the page's colours until the picture is written


@dataclass(frozen=True)
class Look:
    """Colour by name of a CSS variable, on light (its stand-in in pictures) and dark; a mark."""

    name: str
    color: str
    dark: str
    mark: str


# After Okabe & Ito (2008): told apart under every common colour blindness.
_LOOKS = {
    "mcl": Look("blue", "#0072b2", "#4aa8e0", "o"),
    "mcl-smoother": Look("sky", "#56b4e9", "#8fd0f7", "s"),
    "mcl-map": Look("green", "#009e73", "#2fc79b", "^"),
    "mcl-map-smoother": Look("amber", "#e69f00", "#f5b83d", "v"),
    "mcl-plan": Look("purple", "#cc79a7", "#e6a3c7", "P"),
    "deq-mcl": Look("red", "#d55e00", "#ff8a3d", "D"),
    "dead-reckoning": Look("gray", "#777777", "#a8a8a8", "X"),
}
_MORE = (
    Look("brown", "#8c510a", "#d69a5b", ">"),
    Look("slate", "#44596e", "#9db4cb", "d"),
    Look("olive", "#8a7a00", "#d1c04a", "h"),
    Look("violet", "#6a51a3", "#a994e0", "<"),
    Look("teal", "#117a8b", "#4cc3d6", "*"),
    Look("rose", "#b2185d", "#f277ad", "p"),
    Look("lime", "#6b9a00", "#b5e04a", "H"),
    Look("navy", "#1f3b8f", "#8aa6ff", "8"),
)
LOOKS = (*_LOOKS.values(), *_MORE)


def looks(labels: Iterable[str]) -> dict[str, Look]:
    """Give each label a look of its own; those that we do not know take what is left, in order.

    Where there are more labels than colours, a colour is used again with other marks.
    """
    listed = list(dict.fromkeys(labels))
    left = [*_MORE, *(look for name, look in _LOOKS.items() if name not in listed)]
    strangers = [label for label in listed if label not in _LOOKS]
    taken = {
        label: replace(left[i % len(left)], mark=left[(i + i // len(left)) % len(left)].mark)
        for i, label in enumerate(strangers)
    }
    return {label: (_LOOKS | taken)[label] for label in listed}
