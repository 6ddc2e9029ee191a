"""Documents: links and names lead somewhere, questions have answers, lengths, tables of code."""

import inspect
import json
import pkgutil
import re
from dataclasses import fields
from pathlib import Path
from urllib.parse import unquote

import gymnasium as gym
import pytest

from deqmcl_gym import Office, world
from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.maps import Mount
from deqmcl_gym.world import WORLDS
from docs import tables, tables_of_code

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
    prose = CODE.sub("", FENCE.sub("", text))
    return [next(filter(None, found)) for found in TARGETS.findall(prose)]


def anchors(text):
    """Names by which GitHub lets one link to the headings of a text, and those given by hand."""
    found = []
    for heading in re.findall(r"^#{1,6}[ \t]+(.+?)[ \t]*#*$", FENCE.sub("", text), re.MULTILINE):
        words = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)  # a link's words count
        name = re.sub(r"[^\w\- ]", "", words.replace("`", "").lower()).replace(" ", "-")
        twin = re.escape(name) + r"(-\d+)?"
        twins = sum(re.fullmatch(twin, other) is not None for other in found)
        found.append(f"{name}-{twins}" if name in found else name)
    return {*found, *re.findall(r"""\b(?:id|name)=["']([^"']+)["']""", text)}


def broken(document):
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
    try:
        pkgutil.resolve_name(dotted)
    except (ImportError, AttributeError):
        return False
    return True


@pytest.mark.parametrize("document", CURRENT, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_every_name_of_code_is_where_the_document_says(document):
    assert list(gone(document)) == []


ANSWERS = {
    # somebody in a notebook
    "How do I install it without make?": "README.md#install-and-run",
    "What is worth a plan, in one table?": "README.md#what-a-plan-is-worth",
    "What does DEQ-MCL do in one step?": "docs/deq-mcl.ipynb#one-step-by-hand",
    "Why did it lose one run in ten?": "docs/deq-mcl.ipynb#why-it-lost-one-run-of-ten",
    "How do I get a LaTeX table?": "docs/deq-mcl.ipynb#your-own-localizer",
    "My folder is of older code, what now?": "docs/sweeps.md#after-a-change-of-code",
    "What becomes of an interrupted sweep?": "docs/sweeps.md#stop-resume-repeat",
    "How is an error computed?": "docs/reports.md#scores-of-a-trial",
    "What does this parameter do?": "docs/equations.md#parameters",
    # somebody who trains policies
    "What is in info?": "docs/environment.md#info",
    "How do I draw an L-shaped obstacle?": "docs/environment.md#your-own-room",
    "How do I scale observations?": "docs/environment.md#observations-and-actions-in--1-1",
    "How do I record a video?": "docs/environment.md#pictures",
    # somebody with a robot
    "The start is not known, what then?": "docs/your-map-your-log.md#where-the-robot-starts",
    "My lidar has a code for no return.": "docs/your-map-your-log.md#what-drivers-send",
    "By which score do I tune?": "docs/tune-on-your-log.md#which-score",
    "How do I score slam_toolbox?": "docs/tune-on-your-log.md#score-your-own-stack",
    "Is it lost, or is the map wrong?": "docs/wrong-map.md#is-it-lost-or-is-the-map-wrong",
}


@pytest.mark.parametrize("question", ANSWERS)
def test_a_question_has_its_answer(question):
    page, _, heading = ANSWERS[question].partition("#")
    text = (ROOT / page).read_text(encoding="utf-8")
    if page.endswith(".ipynb"):
        cells = json.loads(text)["cells"]
        text = "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    assert heading in anchors(text)


REPORTS = ROOT / "docs" / "reports"
MOST = {"README.md": 1000, "CONTRIBUTING.md": 1000, "CHANGELOG.md": 1500, "docs/decisions.md": 3500}
SHORT = {ROOT / name for name in MOST}
PAGES = [path for path in DOCUMENTS if path not in SHORT and REPORTS not in path.parents]


def words(path):
    return len(path.read_text(encoding="utf-8").split())


@pytest.mark.parametrize(("name", "most"), MOST.items())
def test_a_document_is_short(name, most):
    assert words(ROOT / name) <= most


def test_all_pages_together_are_an_afternoon():
    assert sum(map(words, PAGES)) <= 36_000


def test_a_decision_is_told_in_150_words():
    sections = re.split("^## ", (ROOT / "docs" / "decisions.md").read_text(), flags=re.MULTILINE)
    assert len(sections) > 20
    assert max(len(section.split()) for section in sections) <= 150


def test_every_table_of_the_pages_is_that_of_its_report():
    assert tables.main(["--check"]) == 0


def rows(table):
    return {cells[0].strip("`"): cells[1:] for cells in table[1]}


def test_every_id_has_a_row_with_its_steps():
    found = rows(tables_of_code.ids())
    ours = {name for name in gym.registry if name.startswith("deqmcl_gym/")}
    assert {f"deqmcl_gym/{name}" for name in found} == ours
    assert found["Room-v0"][-2] == "408"
    assert found["Localize-v0"][-2] == "300"
    assert "`lidar.beams=9`" in found["Sharp-v0"][1]


def test_the_arguments_of_a_room_are_those_of_its_signature_and_of_all_parts():
    parts = {name: getattr(WORLDS["paper"], name) for name in ("lidar", "robot", "noise")}
    parts |= {name: getattr(WORLDS["paper"], name) for name in ("start", "lap")}
    parts |= {name: kind() for name, kind in world._OPTIONAL.items()}
    keys = {f"{name}.{own.name}" for name, part in parts.items() for own in fields(part)}
    given = set(inspect.signature(RoomEnv).parameters) - {"unknown"}
    asked = given - {"lidar", "robot", "noise", "start", "lap"}
    found = rows(tables_of_code.arguments("Room-v0"))
    assert set(found) == asked | keys
    assert all(said for _, said in found.values())
    assert found["lidar.field_of_view"][0] == "`π/2`"
    assert found["lidar.max_range"][0] == "`400.0` px"


@pytest.mark.parametrize("name", ["Localize-v0", "Track-v0"])
def test_the_arguments_of_a_task_are_those_of_the_classes_that_it_is_made_of(name):
    found = rows(tables_of_code.arguments(name))
    assert {"localizer", "floor_plan", "max_steps", "particles", "render_mode"} <= set(found)
    gym.make(f"deqmcl_gym/{name}", localizer={"name": "mcl-map", "particles": 10},
             **dict.fromkeys(("floor_plan", "lidar", "robot", "noise", "cell")))  # fmt: skip


def test_the_arguments_of_a_log_are_all_there_and_so_are_the_keys_of_a_part():
    given = set(inspect.signature(LogEnv).parameters) - {"others"}
    assert set(rows(tables_of_code.arguments("Log-v0"))) == given
    for part in (Office, Mount):
        found = rows(tables_of_code.arguments(part.__name__))
        assert set(found) == {own.name for own in fields(part)}
        assert all(re.search(r"\w", said) for _, said in found.values())
