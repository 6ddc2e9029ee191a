"""What a localizer is and what it takes, in words: ``describe("mcl-plan")``."""

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, get_args, get_origin

from deqmcl_gym.validation import shown
from localizers import registry

_NOT_NAMED = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
REQUIRED = inspect.Parameter.empty  # in place of a default


class ParameterWords(NamedTuple):
    """A parameter of a localizer."""

    name: str
    default: Any  # ``REQUIRED`` without one
    meaning: str  # with its range; "" if its author has not said it

    @property
    def default_words(self) -> str:
        """The default as code."""
        return "required" if self.default is REQUIRED else shown(self.default)


@dataclass(frozen=True)
class Description:
    """What a localizer is, and its parameters; a shell and a notebook show it as a table."""

    name: str
    sentence: str  # first line of its docstring
    parameters: tuple[ParameterWords, ...]

    def __str__(self) -> str:
        rows = [(p.name, p.default_words, p.meaning) for p in self.parameters]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = (
            "  " + "  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip()
            for row in rows
        )
        head = f"{self.name}: {self.sentence.replace('``', '')}".removesuffix(": ")
        return "\n".join([head, *(["", *lines] if rows else [])])

    def _repr_markdown_(self) -> str:
        rows = [(f"`{p.name}`", f"`{p.default_words}`", p.meaning) for p in self.parameters]
        cells = [("parameter", "default", "what it is"), ("---",) * 3, *rows]
        lines = ("| " + " | ".join(c.replace("|", r"\|") for c in row) + " |" for row in cells)
        head = f"**{self.name}**: {self.sentence.replace('``', '`')}"
        return "\n".join([head, *(["", *lines] if rows else [])]) + "\n"


def describe(name: str | Callable[..., Any]) -> Description:
    """Say what a localizer is: built in, a plug-in by its name, or a class.

    A parameter's meaning is that of ``Annotated[int, "at least 1"]``, or of its line in the
    docstring's ``Args:``.
    """
    factory = registry.resolve(name) if isinstance(name, str) else name
    source = inspect.unwrap(getattr(factory, "func", factory))  # of a partial
    text = inspect.cleandoc(source.__doc__ or "")
    if inspect.isclass(source) and text.startswith(f"{source.__name__}("):
        text = ""  # a dataclass's own
    sentence = text.partition("\n")[0].removeprefix("Return ")
    known = _args_of("\n".join([text, inspect.cleandoc(_init_words(source))]))
    return Description(
        name if isinstance(name, str) else getattr(name, "__name__", type(name).__name__),
        sentence[:1].upper() + sentence[1:],
        tuple(
            ParameterWords(one.name, one.default, _meaning(one) or known.get(one.name, ""))
            for one in _parameters_of(factory)
        ),
    )


def _parameters_of(factory: Callable[..., Any]) -> list[inspect.Parameter]:
    for evaluated in (True, False):  # a plug-in's annotations may name what cannot be found
        try:
            listed = list(inspect.signature(factory, eval_str=evaluated).parameters.values())
        except Exception:
            continue
        return [one for one in listed[1:] if one.kind not in _NOT_NAMED]
    return []


def _meaning(one: inspect.Parameter) -> str:
    said = get_args(one.annotation)[1:] if get_origin(one.annotation) is Annotated else ()
    return next((words for words in said if isinstance(words, str)), "")


def _init_words(source: Any) -> str:
    return (source.__init__.__doc__ or "") if inspect.isclass(source) else ""


def _args_of(text: str) -> dict[str, str]:
    """Words of parameters by name, of the part ``Args:`` of a docstring."""
    found: dict[str, str] = {}
    part = re.search(r"^Args:\n((?:[ \t]+.*\n?|\n)*)", text, re.MULTILINE)
    lines = inspect.cleandoc("\n" + part[1]) if part else ""
    for names, words in re.findall(r"^(\w[^:\n]*):((?:.*\n?)(?:[ \t]+.*\n?)*)", lines, re.M):
        for name in names.split(","):
            found[name.split("(")[0].strip()] = " ".join(words.split())
    return found
