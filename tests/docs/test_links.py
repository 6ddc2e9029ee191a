"""Every link within the documents leads somewhere, and every name of code is there."""

import pkgutil
import re
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[2]
OUTSIDE = [ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "CHANGELOG")]
DOCUMENTS = sorted([*OUTSIDE, *(ROOT / "docs").rglob("*.md")])
# what describes the code as it is, not as it was
CURRENT = [path for path in DOCUMENTS if not path.name.startswith("CHANGELOG")]

FENCE = re.compile(r"^(```|~~~).*?^\1[ \t]*$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"(`+)(?!`).*?(?<!`)\1(?!`)", re.DOTALL)
TARGETS = re.compile(
    r"""\]\(\s*<?([^()\s<>]+(?:\([^()\s]*\))?[^()\s<>]*)>?(?:\s+["'(][^)]*)?\)"""  # [words](target)
    r"""|^\s{0,3}\[[^\]]+\]:\s*<?(\S+?)>?(?:\s|$)"""  # [words]: target
    r"""|<(?:a|img|source|video)\b[^>]*?\b(?:href|src|srcset)\s*=\s*["']([^"']+)["']""",
    re.MULTILINE,
)
# `NAME` linked to a file, or said to be in or of a linked one
NAMES = re.compile(
    r"(?:`(?P<near>\w+)` (?:in|of) )?\[`(?P<linked>[^`]+)`\]\((?P<file>[^)#\s]+\.py)\)"
    r"|`(?P<dotted>(?:benchmarks|deqmcl_gym|localizers)(?:\.\w+)+)(?:\([^`]*\))?`"
)
ELSEWHERE = re.compile(r"[a-z][a-z0-9+.-]*:", re.IGNORECASE)  # http:, https:, mailto:


def targets(text):
    """Where the links and images of a Markdown text lead, code left out."""
    prose = CODE.sub("", FENCE.sub("", text))
    return [next(filter(None, found)) for found in TARGETS.findall(prose)]


def anchors(text):
    """Names by which GitHub lets one link to the headings of a text, and those given by hand."""
    found = []
    for heading in re.findall(r"^#{1,6}[ \t]+(.+?)[ \t]*#*$", FENCE.sub("", text), re.MULTILINE):
        words = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)  # a link's words count
        name = re.sub(r"[^\w\- ]", "", words.replace("`", "").lower()).replace(" ", "-")
        twins = sum(
            re.fullmatch(re.escape(name) + r"(-\d+)?", other) is not None for other in found
        )
        found.append(f"{name}-{twins}" if name in found else name)
    return {*found, *re.findall(r"""\b(?:id|name)=["']([^"']+)["']""", text)}


def broken(document):
    """Links of a document that lead nowhere, with the reason."""
    text = document.read_text()
    for target in targets(text):
        if ELSEWHERE.match(target):
            continue
        path, _, anchor = unquote(target).partition("#")
        place = document if not path else (document.parent / path)
        if not place.exists():
            yield f"{target}: there is no {path}"
        elif ROOT not in (place.resolve(), *place.resolve().parents):
            yield f"{target}: leads out of the project"
        elif anchor and place.suffix == ".md" and anchor not in anchors(place.read_text()):
            yield f"{target}: {place.name} has no heading #{anchor}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_every_link_and_image_leads_to_a_file_and_a_heading_that_are_there(document):
    assert list(broken(document)) == []


def gone(document):
    """Names of code in a document that are not where it says."""
    for found in NAMES.finditer(FENCE.sub("", document.read_text())):
        if dotted := found["dotted"]:
            if not there(dotted):
                yield dotted
            continue
        if not (source := document.parent / found["file"]).is_file():
            continue  # a broken link
        names = [] if found["linked"].endswith(".py") else re.findall(r"\w+", found["linked"])
        known = set(re.findall(r"\w+", source.read_text()))
        yield from (name for name in [*names, found["near"]] if name and name not in known)


def there(dotted):
    """Whether a dotted name is a module, or an attribute of one."""
    try:
        pkgutil.resolve_name(dotted)
    except (ImportError, AttributeError):
        return False
    return True


@pytest.mark.parametrize("document", CURRENT, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_every_name_of_code_is_where_the_document_says(document):
    assert list(gone(document)) == []
