"""No tracked text names a folder of one machine or the address of a package registry."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# Put together from pieces, so that this file does not match itself.
FOLDERS = re.compile(
    r"(?<![\w.~-])/(?:" + "|".join(("work", "root", "home", "Users")) + r")/[\w.-]"
)
REGISTRIES = re.compile(
    r"https?://[\w.@:-]*(?:"
    + "|".join(
        (
            r"pypi" + r"\.org",
            r"pythonhosted" + r"\.org",
            r"anaconda" + r"\.(?:org|com)",
            r"npmjs" + r"\.(?:org|com)",
            r"crates" + r"\.io",
            r"proxy\.golang" + r"\.org",
            r"(?:artifactory|nexus|devpi)",
        )
    )
    + ")"
)


def tracked():
    """Files that are in git, or would be with the next ``git add``; read as text where they are."""
    done = subprocess.run(
        ["git", "-C", ROOT, "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        pytest.skip("not a git checkout")
    return sorted(ROOT / name for name in set(done.stdout.split("\0")) - {""})


def texts():
    for path in tracked():
        try:
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        except (FileNotFoundError, IsADirectoryError, UnicodeDecodeError):
            continue  # deleted, a submodule, or a picture


def found(pattern):
    return [
        f"{name}:{number}: {line.strip()[:100]}"
        for name, text in texts()
        for number, line in enumerate(text.splitlines(), 1)
        if pattern.search(line)
    ]


def test_no_text_names_a_folder_of_one_machine():
    assert found(FOLDERS) == []


def test_no_text_names_the_address_of_a_package_registry():
    assert found(REGISTRIES) == []


def test_the_search_sees_the_texts_of_the_project():
    assert {"README.md", "pyproject.toml", "benchmarks/cli.py"} <= {name for name, _ in texts()}


@pytest.mark.parametrize("folder", ["work", "root", "home", "Users"])
@pytest.mark.parametrize("around", ["{}main", "see {}x.", '"{}a"', "(file://{}a)", "PATH={}a/b"])
def test_a_folder_of_a_machine_is_noticed(folder, around):
    assert FOLDERS.search(around.format("/" + folder + "/")) is not None


@pytest.mark.parametrize("words", ["docs/" + "work" + "/a", "~/" + "work" + "/a", "/workshop/a"])
def test_a_folder_of_the_project_is_not(words):
    assert FOLDERS.search(words) is None


@pytest.mark.parametrize(
    "host", ["pypi" + ".org", "www.pypi" + ".org", "files.pythonhosted" + ".org"]
)
def test_the_address_of_a_registry_is_noticed(host):
    assert REGISTRIES.search(f"see https://{host}/simple") is not None
    assert REGISTRIES.search(f"see {host}") is None  # a name is no address
