"""The queue by ancestry against a queue that copies all its states at every resampling."""

import numpy as np
import pytest

from localizers.inference.queue import Queue, SlidingComposition


class CopyingQueue:
    """The oracle: a list of states (d, n), reordered as a whole."""

    def __init__(self, states: np.ndarray) -> None:
        self.states, self.present = [states], 0

    def resampled(self, ancestors: np.ndarray) -> None:
        self.states = [states[:, ancestors] for states in self.states]

    def appended(self, states: np.ndarray) -> None:
        self.states.append(states)

    def stepped(self, past: int) -> None:
        self.present += 1
        drop = max(self.present - past, 0)
        self.states, self.present = self.states[drop:], self.present - drop

    def cut(self, keep: int) -> None:
        self.states = self.states[: self.present + keep + 1]

    def at(self, offset: int) -> np.ndarray | None:
        index = self.present + offset
        return self.states[index] if 0 <= index < len(self.states) else None


def assert_same(queue: Queue, oracle: CopyingQueue) -> None:
    assert queue.ahead == len(oracle.states) - 1 - oracle.present
    for offset in range(-12, 13):
        seen, expected = queue.at(offset), oracle.at(offset)
        assert (seen is None) == (expected is None)
        if seen is not None:
            assert np.array_equal(seen, expected)


@pytest.mark.parametrize("seed", range(60))
def test_a_random_program_gives_the_states_of_a_copying_queue(seed):
    rng = np.random.default_rng(seed)
    n, past = int(rng.integers(1, 9)), int(rng.integers(0, 6))

    def fresh() -> np.ndarray:
        return rng.integers(0, 10**9, (2, n))  # every state tells its origin

    start = fresh()
    queue, oracle = Queue((start,)), CopyingQueue(start)
    for _ in range(120):
        move = rng.choice(["resample", "append", "step", "cut"], p=[0.35, 0.3, 0.25, 0.1])
        if move == "resample":
            ancestors = np.sort(rng.integers(0, n, n))
            queue = queue.resampled(ancestors)
            oracle.resampled(ancestors)
        elif move == "append" and queue.ahead < 8:
            states = fresh()
            queue = queue.appended(states)
            oracle.appended(states)
        elif move == "step" and queue.ahead:
            queue = queue.stepped(past)
            oracle.stepped(past)
        elif move == "cut" and queue.ahead:
            keep = int(rng.integers(0, queue.ahead + 1))
            queue = queue.cut(keep)
            oracle.cut(keep)
        assert_same(queue, oracle)


def test_an_older_queue_stays_right_whatever_is_made_of_it_or_written_into_its_states():
    start = np.random.default_rng(1).integers(0, 99, (1, 4))
    queue = Queue((start.copy(),)).appended(start + 100)
    resampled = queue.resampled(np.array([3, 3, 3, 3]))
    resampled.appended(start).stepped(0).cut(0)
    for offset in (0, 1):
        queue.at(offset)[:] = resampled.at(offset)[:] = 777
        assert np.array_equal(queue.at(offset), start + 100 * offset)
        assert (resampled.at(offset) == start[0, 3] + 100 * offset).all()


@pytest.mark.parametrize("seed", range(20))
def test_a_sliding_composition_is_the_composition_of_the_links_it_holds(seed):
    rng, n = np.random.default_rng(seed), 6
    window, held = SlidingComposition(), []
    for _ in range(200):
        if held and rng.random() < 0.5:
            window = window.pop()
            held.pop(0)
        else:
            link = None if rng.random() < 0.3 else rng.integers(0, n, n)
            window = window.push(link)
            held.append(link)
        plain = np.arange(n)  # from the newest slot's order back to the oldest's
        for link in reversed(held):
            plain = plain if link is None else link[plain]
        composed = window.composed()
        assert np.array_equal(np.arange(n) if composed is None else composed, plain)
