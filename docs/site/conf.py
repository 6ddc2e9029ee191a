"""Sphinx configuration for ``make site``. The source is the whole clone, so that links work."""

import logging
import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from numpy.typing import ArrayLike
from sphinx.ext import autodoc
from sphinx.ext.autodoc import typehints
from sphinx.ext.napoleon import docstring
from sphinx.util.typing import stringify_annotation

import deqmcl_gym
from benchmarks.report.tables import parted

project = "deqmcl-gym"
author = copyright = "the deqmcl-gym authors"  # noqa: A001 - Sphinx' name for it
version = release = deqmcl_gym.__version__

extensions = [
    "myst_nb",  # with myst_parser
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
]
root_doc = "README"
include_patterns = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs/**"]
exclude_patterns = ["docs/examples/**", "docs/gallery/*.ipynb", "**/sg_execution_times.*"]
suppress_warnings = ["config.cache"]

myst_heading_anchors = 4  # as GitHub names them
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
html_math_renderer = "mathml"

nb_execution_mode = "force"  # the notebook has no outputs in the repository
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_output_stderr = "remove"  # progress
nb_ipywidgets_js = {}  # no network: a slider moves in a live notebook only

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_format = "short"
autodoc_typehints_description_target = "documented_params"  # of dataclasses: as attributes only

GALLERY = (
    "first_localizer", "custom_room", "many_rooms", "plan_sensor", "doors", "theta_phase",
    "lost_in_a_building", "your_map", "your_log", "sweep_and_report", "figures_for_a_paper",
    "learned_scan_model", "ppo", "ppo_localize",
)  # fmt: skip


logging.getLogger("fontTools").setLevel(logging.WARNING)  # of every font in a PDF


class FromFirstSteps:
    """The gallery's order; a script that is not in it stops the build."""

    def __init__(self, folder):
        pass

    def __call__(self, script):
        return GALLERY.index(str(script).removesuffix(".py"))


sphinx_gallery_conf = {
    "examples_dirs": "docs/examples",
    "gallery_dirs": "docs/gallery",
    "filename_pattern": r"examples/(?!ppo)",  # run all but those that need PyTorch
    "ignore_pattern": r"conftest",
    "within_subsection_order": FromFirstSteps,
    "show_memory": False,
    "write_computation_times": False,
    "min_reported_time": 10**6,
    "download_all_examples": False,
    "abort_on_example_error": True,
}

html_theme = "furo"
html_title = f"deqmcl-gym {release}"
html_show_sphinx = False
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]

ARRAY = re.compile(r"~?(?:numpy\.)?ndarray\[tuple\[.*?Any, \.\.\.\], [^[]*dtype\[([^]]*)\]\]")


def _named(annotation, *arguments, **options):
    """A type as written in the code, not expanded as NumPy does."""
    text = stringify_annotation(annotation, *arguments, **options)
    text = text.replace(stringify_annotation(ArrayLike, *arguments, **options), "ArrayLike")
    return ARRAY.sub(r"NDArray[\1]", text)


for module in (autodoc, typehints, docstring):
    module.stringify_annotation = _named

HATS = re.compile(r"\\hat (\w)")  # else an index goes below the letter
SPELLINGS = (
    (r"\gt ", "> "),
    (r"\lt ", "< "),
    (r"\dots", r"\ldots"),
    ("°", r"^{\circ}"),
    ("½", r"\frac{1}{2}"),
)


def _tree(caption, *documents):
    """A part of the table of contents; not in the files, as GitHub does not know toctree."""
    options = [":hidden:", ":glob:", *([f":caption: {caption}"] if caption else [])]
    return "\n".join(["", "```{toctree}", *options, *documents, "```", ""])


CONTENTS = {
    "README": _tree(
        "Learn",
        "docs/deq-mcl",
        "docs/quickstart",
        "docs/gallery/index",
    )
    + _tree(
        "Do",
        "docs/write-a-localizer",
        "docs/sweeps",
        "docs/acting",
        "docs/your-map-your-log",
        "docs/tune-on-your-log",
    )
    + _tree(
        "Look up",
        "docs/environment",
        "docs/reports",
        "docs/equations",
        "docs/classical",
        "docs/faq",
        "docs/site/api",
        "docs/site/api-wrappers",
        "docs/site/api-benchmarks",
    )
    + _tree(
        "Results",
        "docs/plan-sensor",
        "docs/wrong-map",
        "docs/speed",
        "docs/reports/README",
    )
    + _tree(
        "The project",
        "docs/README",
        "docs/architecture",
        "docs/decisions",
        "CONTRIBUTING",
        "CHANGELOG",
    ),
    "docs/reports/README": _tree("", "*", "*/*"),
}


def _with_contents(app, document, source):
    source[0] += CONTENTS.get(document, "")


LETTERS = 95  # of a table, across the page
WORDS = 34  # letters of its first column, in which lines may break anywhere


def _keep_cells_whole(app, document):
    """Break all cells of a table before an interval, as reports do, or none."""
    for table in document.findall(nodes.table):
        rows = [[cell.astext() for cell in row] for row in table.findall(nodes.row)]
        most = [max(map(len, column)) for column in zip(*rows, strict=True)]
        most[0] = min(most[0], WORDS)
        table["classes"] += ["wide"] if sum(most) + 2 * len(most) > LETTERS else []
        for text in list(table.findall(nodes.Text)):
            if not isinstance(text.parent, nodes.literal | nodes.math):
                value, ends = parted(text.astext())
                shown = [nodes.Text(f"{value} "), nodes.inline("", ends, classes=["ends"])]
                text.parent.replace(text, shown if ends else nodes.Text(value))


def _as_mathml(self, node, as_block):
    """Formulas as MathML: no script, no network."""
    text = HATS.sub(r"{\\hat \1}", node.astext())
    for written, spelling in SPELLINGS:
        text = text.replace(written, spelling)
    formula = tex2mathml(text, as_block=as_block)
    self.body.append(f'<div class="math">{formula}</div>' if as_block else formula)
    raise nodes.SkipNode


def setup(app):
    """Add the table of contents, and formulas as MathML."""
    app.connect("source-read", _with_contents)
    app.connect("doctree-read", _keep_cells_whole)
    app.add_html_math_renderer(
        "mathml",
        (lambda writer, node: _as_mathml(writer, node, False), None),
        (lambda writer, node: _as_mathml(writer, node, True), None),
    )
