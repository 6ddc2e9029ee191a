"""What is handed in for a leaderboard: folders of a suite's results, and what is wrong with them.

A submission is the folder of a public run, the files of its plug-ins beside or in it, and later the
folder of its held-out run. What a folder says of itself is recomputed here, not believed.
"""

import itertools
import secrets
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from benchmarks.execution.apart import provenance
from benchmarks.execution.engines import Where
from benchmarks.files import locked, refuse_changed
from benchmarks.setup.changes import renamed, spelt
from benchmarks.setup.names import plug_ins_of_agent, plug_ins_of_scan
from benchmarks.sweeps import manifest
from benchmarks.sweeps.held_out import HeldOut, submission
from benchmarks.sweeps.manifest import Manifest, differences
from benchmarks.sweeps.results import Results, recorded_sweep, results_in
from benchmarks.sweeps.suites import SUITES
from benchmarks.sweeps.verifying import Again, run_again
from benchmarks.trials.provenance import code_digest
from deqmcl_gym.validation import InputError
from localizers.naming.registry import is_plug_in

_DIGITS = 12  # of a digest
_FREE = ("title", "localizers", "seed", "held_out")  # what a submission has of its own


class RefusedError(RuntimeError):
    """A submission is not what it says."""

    exit_code = 1


@dataclass(frozen=True, kw_only=True)
class Handed:
    """A folder of results, read as data: nothing that it names is loaded.

    Attributes:
        number: from 1, in the order in which folders are given.
        folder: where.
        made: its manifest.
        results: what it holds.
        again: a sample of it that was run again here, and agrees; None: nothing was run again.
        looked_up: whether whoever asks has looked up its public value.
    """

    number: int
    folder: Path
    made: Manifest
    results: Results
    again: Again | None = None
    looked_up: bool = False

    @cached_property
    def held_out(self) -> HeldOut | None:
        """What its seed is said to follow from; None: it is a public run."""
        said = self.made.sweep.get("held_out")
        return None if said is None else HeldOut(**said)

    @cached_property
    def digest(self) -> str:
        """The digest of what was handed in: the same of the public and the held-out run."""
        return submission(self.made.sweep, self.made.made)

    @property
    def label(self) -> str:
        """How its numbers are known: ``reported``, ``re-run`` or ``re-run held-out``.

        Re-run: a sample of trials was run again here, and agrees to the last digit. Held-out:
        beside that, the seed follows from the submission and a value that was looked up.
        """
        if self.again is None:
            return "reported"
        return "re-run held-out" if self.held_out and self.looked_up else "re-run"

    @property
    def known_by(self) -> str:
        """Say how it came by its label."""
        if self.again is None:
            return "nothing was run again"
        checked = self.again.checked
        words = f"{len(checked.keys):,} of {checked.of:,} trials run again, none differs"
        if checked.code != self.made.made.code:
            words += f", under code {checked.code[:_DIGITS]}"
        if self.held_out is None:
            return words
        up = "looked up" if self.looked_up else "not looked up"
        return f"{words}; seed from the submission and a value that was {up}"


def handed_in(folders: Sequence[Path]) -> list[Handed]:
    """Read folders of results.

    Raises:
        InputError: one is given twice, or is no folder of results.
    """
    for place, folder in enumerate(folders):
        if folder.resolve() in {one.resolve() for one in folders[:place]}:
            raise InputError(f"{folder} is given twice: name each folder once.")
    return [
        Handed(number=n, folder=one, made=manifest.read(one), results=results_in(one))
        for n, one in enumerate(folders, 1)
    ]


def faults(one: Handed) -> list[str]:
    """Say in a sentence each what is wrong with a folder, as far as is known without running it."""
    found = [*seed_fault(one), *_suite_fault(one), *_trial_faults(one), *_plug_in_faults(one)]
    if one.held_out and one.made.made.code != code_digest():
        found.append(
            f"its held-out seed has the code {one.made.made.code[:_DIGITS]} in it, and this is "
            f"{code_digest()[:_DIGITS]}: verify it by the version of deqmcl-gym that made it."
        )
    try:
        refuse_changed(one.folder)
    except InputError as error:
        found.append(str(error))
    return [f"{one.folder}: {fault}" for fault in found]


def verified(one: Handed, where: Where, share: float) -> Handed:
    """Run a sample of a folder again that nobody foresees; return it with what was found.

    It has no ``faults``. If trials differ, ``again`` says so.
    """
    with locked(one.folder):
        again = run_again(
            one.folder, one.made, where, share, here=_here(one), draw=secrets.token_hex(16)
        )
    return replace(one, again=again)


def seed_fault(one: Handed) -> Iterator[str]:
    """Say that its seed is not what the public value gives, if it is said to be."""
    if one.held_out is None:
        return
    seed, own = one.made.sweep["seed"], one.held_out.seed(one.digest)
    if seed != own:
        yield (
            f"its seed is {seed}, but {own} follows from the digest of what was handed in and the "
            "public value: run it with --held-out."
        )


def _suite_fault(one: Handed) -> Iterator[str]:
    """Say how its sweep differs from the suite that it is nearest to."""
    apart = {name: list(_differences(suite.canonical(), one)) for name, suite in SUITES.items()}
    name = min(apart, key=lambda name: len(apart[name]))
    if apart[name]:
        more = f" and {len(apart[name]) - 1} more" if len(apart[name]) > 1 else ""
        yield (
            f"it is of no suite, {name} being the nearest ({apart[name][0]}{more}): run deqmcl "
            "sweep SUITE and change nothing but --with, or the agents."
        )


def _differences(suite: dict[str, Any], one: Handed) -> Iterator[str]:
    """Say where a sweep differs from a suite, but for what it may have more."""
    given = _more_agents(suite, one.made.sweep)
    for method in suite["localizers"]:
        if spelt(method) not in map(spelt, given["localizers"]):
            yield f"localizers have no {method['name']}"
    free = _FREE if one.held_out else tuple(name for name in _FREE if name != "seed")
    theirs, ours = ({k: v for k, v in said.items() if k not in free} for said in (suite, given))
    yield from differences(theirs, ours)


def _more_agents(suite: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """Return a sweep without agents that are its own, if it varies them as the suite does."""
    axes = [
        axis | {"agent": [a for a in axis["agent"] if spelt(a) in map(spelt, own["agent"])]}
        if "agent" in axis and "agent" in own
        else axis
        for axis, own in zip(given.get("vary", []), suite["vary"], strict=False)
    ]
    return given | {"vary": axes + given.get("vary", [])[len(axes) :]}


def _trial_faults(one: Handed) -> Iterator[str]:
    """Say which files of trials are not as they were written, and how many are missing."""
    for name, why in one.results.left_out.items():
        yield f"{name} {why}: hand in the folder as the sweep wrote it."
    if one.results.missing and not one.results.left_out:
        yield (
            f"{one.results.missing} of {one.results.planned} trials were not run: finish its sweep."
        )
    if one.results.failures:
        yield (
            f"{len(one.results.failures)} of {one.results.planned} trials failed: hand in a method "
            "that finishes all."
        )


def _plug_in_faults(one: Handed) -> Iterator[str]:
    """Say which plug-ins have no digest, are not here, or are not what made the results."""
    said, places = one.made.made.plug_ins, _places(one)
    for name in _guests(one):
        if name not in said:
            yield f"its manifest has no digest of {_file(name).name}: run the sweep again."
    for name in said:
        if name not in places:
            yield (
                f"{_file(name).name}, which it was run with, is not here: put it into the folder "
                "or beside it."
            )
    if len(places) < len(said):
        return
    if len({*places.values()}) < len(places):
        yield "two of its plug-ins have one file name: rename a file, and run the sweep again."
        return
    now = provenance(recorded_sweep(one.folder, _here(one)).cells()).plug_ins
    for name, digest in said.items():
        if (found := now.get(places[name], "")) != digest:
            yield (
                f"{_file(places[name])} is not what made the results (SHA-256 {digest[:_DIGITS]} "
                f"made them, this is {found[:_DIGITS] or 'not to be read'}): hand in the file that "
                "did."
            )


def _guests(one: Handed) -> dict[str, None]:
    """Return the names of all that its trials run or read and that is not ours."""
    found: dict[str, None] = {}
    for trial in recorded_sweep(one.folder, one.made).cells():
        localizer = [trial.localizer] if is_plug_in(trial.localizer) else []
        own = plug_ins_of_agent(trial.agent), plug_ins_of_scan(trial.assumed), trial.files
        found |= dict.fromkeys([*localizer, *itertools.chain.from_iterable(own)])
    return found


def _here(one: Handed) -> Manifest:
    """Return its manifest with plug-ins named by where their files are here."""
    places = _places(one)
    parameters = {places.get(name, name): own for name, own in one.made.parameters.items()}
    return replace(one.made, sweep=renamed(one.made.sweep, places), parameters=parameters)


def _places(one: Handed) -> Mapping[str, str]:
    """Return the names that plug-ins have here: of the file in the folder or beside it, if any."""
    found = {}
    for name in one.made.made.plug_ins:
        file = _file(name)
        if file.suffix not in (".py", ".toml") and not file.is_absolute():
            found[name] = name  # of a package that is installed
            continue
        known = _file(one.made.places.get(name, name))
        folders = (one.folder, one.folder.resolve().parent, known.parent)
        if (folder := next((own for own in folders if (own / file.name).is_file()), None)) is None:
            continue
        found[name] = f"{folder.resolve() / file.name}{name.removeprefix(str(file))}"
    return found


def _file(name: str) -> Path:
    """Return the file of a plug-in's name: file.py:NAME, room.toml, a log."""
    file, found, _ = name.rpartition(".py:")
    return Path(f"{file}.py") if found else Path(name)
