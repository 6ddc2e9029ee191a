"""What ``deqmcl tune`` measures on: segments of logs, trained on and held out in turn."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.replay.options import Replay
from benchmarks.setup.overrides import Overrides
from deqmcl_gym.validation import InputError

MOST = 24  # segments of each kind
STARTS, DRAWS, ORDER = 0, 1, 2  # children of the seed; trials have keys of their own
_SEARCH = 7  # before them
_LEAST = 2  # segments of each kind
_KNOWN = 0.5  # share of a segment's records that must have a reference
_TRIES = 100  # to draw a start in free space


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Part of a log, from a start that is known with some error.

    Attributes:
        number: among all; it names the random streams of its runs.
        begins: time of its first record, s.
        metres: driven in it.
        world: what is played, as a trial has it.
        whole: the same of the whole log.
        assumed: by the filters, the noise of the whole log and the start among it.
        held_out: whether the search never sees it.
    """

    number: int
    begins: float
    metres: float
    world: Overrides
    whole: Overrides
    assumed: Overrides
    held_out: bool


def segments_of(
    replays: Sequence[Replay], length: float, gap: float, sd: tuple[float, float], seed: int
) -> list[Segment]:
    """Cut logs into segments; the first is trained on, the next held out, and so on.

    Args:
        replays: a log each, in m.
        length, gap: m driven in a segment, and between two.
        sd: standard deviations of the start's position (m) and heading (rad).
        seed: of the errors of the starts, normal with these, drawn again where no robot can be.
    """
    cut = [(replay, ends) for replay in replays for ends in _cut(replay, length, gap)]
    kinds = [cut[0::2], cut[1::2]]
    if min(map(len, kinds)) < _LEAST:
        raise InputError(
            f"the log gives {len(cut)} segments of {length:g} m with a reference, but "
            f"{2 * _LEAST} or more are needed: give a smaller --segment, or more logs."
        )
    listed = [
        (*kind[i], bool(held_out))
        for held_out, kind in enumerate(kinds)
        for i in np.linspace(0, len(kind) - 1, min(len(kind), MOST)).astype(int)
    ]
    return [
        _segment(replay, number, ends, held_out, sd, seed)
        for number, (replay, ends, held_out) in enumerate(listed)
    ]


def _segment(
    replay: Replay,
    number: int,
    ends: tuple[int, int],
    held_out: bool,
    sd: tuple[float, float],
    seed: int,
) -> Segment:
    """Return the records between these ends, both included."""
    (start, last), setup = ends, replay.scenario
    whole, ground = setup.whole, setup.recording()[1]
    assert whole.reference is not None
    true = whole.reference[start]
    off = stream(seed, STARTS, number).standard_normal((_TRIES, 3)) * [sd[0], *sd]
    drawn = np.vstack([true + off, true])
    mean = drawn[int(np.argmax([*ground.free(drawn[:-1]), True]))]
    mean[2] = math.remainder(mean[2], 4 * math.pi)  # within 2π, as a pose must be
    noise = {f"motion.{n}": v for n, v in vars(replay.motion).items() if n != "still"}
    prior = {"prior.mean": tuple(mean.tolist()), "prior.sd_position": sd[0]}
    log = Overrides({name: value for name, value in replay.world.items() if name != "judged"})
    return Segment(
        number=number,
        begins=float(whole.times[start]),
        metres=float(whole.driven[last] - whole.driven[start]),
        whole=log,
        world=log | {"start": start, "length": last - start + 1},
        assumed=Overrides({**noise, **replay.assumed, **prior, "prior.sd_heading": sd[1]}),
        held_out=held_out,
    )


def _cut(replay: Replay, length: float, gap: float) -> Iterator[tuple[int, int]]:
    """Yield the first and the last record of each segment of a log."""
    whole = replay.scenario.whole
    known, way, at = whole.referenced, whole.driven, 0
    while (begin := np.searchsorted(known, at)) < known.size:
        first = int(known[begin])
        last = int(np.searchsorted(way, way[first] + length))
        if last >= len(whole):
            return
        inside = np.searchsorted(known, last, side="right") - begin
        if inside >= _KNOWN * (last - first + 1):
            yield first, last
            at = max(last + 1, int(np.searchsorted(way, way[last] + gap)))
        else:
            at = first + 1


def stream(seed: int, *key: int) -> np.random.Generator:
    """Return a stream of a search, of none of its trials."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_SEARCH, *key)))
