"""The discrete event queue Q(t): states x_{t-L} … x_{t+F} of n particles, resampled by ancestry.

Resampling does not copy states: each slot keeps them as they were drawn, with the index map from
the order of the next slot's particles to its own. Two sliding windows keep the compositions to
the present and to the oldest state, which are read at every step; named tuples are made fastest.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from deqmcl_gym.numerics import Indices
from localizers.inference.particles import States

Link = Indices | None  # None: the identity


class SlidingComposition(NamedTuple):
    """The composition of a window of links, pushed at its new end and popped at its old: O(1).

    Two stacks: the old half holds a composition from each of its links to its end, the new half one
    of all its links. When the old half is used up, the new half is turned into it.
    """

    old: tuple[Link, ...] = ()  # next to be popped: last
    new: tuple[Link, ...] = ()
    running: Link = None

    def push(self, link: Link) -> "SlidingComposition":
        """Add the link of a new slot."""
        return SlidingComposition(self.old, (*self.new, link), compose(self.running, link))

    def pop(self) -> "SlidingComposition":
        """Drop the oldest link."""
        if self.old:
            return SlidingComposition(self.old[:-1], self.new, self.running)
        if len(self.new) == 1:
            return _NOTHING
        turned: list[Link] = []
        for link in reversed(self.new):
            turned.append(compose(link, turned[-1] if turned else None))
        return SlidingComposition(tuple(turned[:-1]))

    def composed(self, first: int = 0) -> Link:
        """Return the map from the newest slot's order to that of the link ``first`` and later."""
        if first < len(self.old):
            return compose(self.old[-1 - first], self.running)
        first -= len(self.old)
        if first == 0:
            return self.running
        order: Link = None
        for link in reversed(self.new[first:]):
            order = compose(link, order)
        return order


_NOTHING = SlidingComposition()


class Queue(NamedTuple):
    """An immutable queue of slots."""

    slots: tuple[States, ...]  # the states as they were drawn, (d, n) each, oldest first
    links: tuple[Link, ...] = ()  # links[i] maps the order of slot i + 1 to that of slot i
    pending: Link = None  # from the current order to that of the newest slot
    present: int = 0  # the index of x_t among the slots
    past: SlidingComposition = _NOTHING  # the composition of the links before the present
    future: SlidingComposition = _NOTHING  # and of those after it

    @classmethod
    def of(cls, states: Sequence[States]) -> "Queue":
        """Return a queue of states x_{t-L} … x_t, (d, n) each, in one order."""
        before = len(states) - 1
        links = (None,) * before
        return cls(tuple(states), links, None, before, SlidingComposition(new=links), _NOTHING)

    @property
    def ahead(self) -> int:
        """How many states after the present are held."""
        return len(self.slots) - 1 - self.present

    def resampled(self, ancestors: Indices) -> "Queue":
        """Keep the whole queues of these particles, (n,)."""
        pending = ancestors if self.pending is None else self.pending[ancestors]
        return Queue(self.slots, self.links, pending, self.present, self.past, self.future)

    def appended(self, states: States) -> "Queue":
        """Add a newest state, (d, n)."""
        slots, links = (*self.slots, states), (*self.links, self.pending)
        future = self.future.push(self.pending)
        return Queue(slots, links, None, self.present, self.past, future)

    def renewed(self, states: States) -> "Queue":
        """Replace the newest states by others, (d, n); only valid before the next resampling."""
        assert self.pending is None
        return self._replace(slots=(*self.slots[:-1], states))

    def stepped(self, past: int) -> "Queue":
        """Let the next state become the present; keep at most ``past`` states before it."""
        future = self.future.pop()
        if past == 0:
            return Queue(self.slots[1:], self.links[1:], self.pending, 0, _NOTHING, future)
        before = self.past.push(self.links[self.present])
        if self.present < past:
            return self._replace(present=self.present + 1, past=before, future=future)
        return Queue(self.slots[1:], self.links[1:], self.pending, past, before.pop(), future)

    def cut(self, keep: int) -> "Queue":
        """Forget the states more than ``keep`` after the present, the current order unchanged."""
        last = self.present + keep
        links, future = self.links[:last], _NOTHING
        for link in links[self.present :]:
            future = future.push(link)
        slots, pending = self.slots[: last + 1], self._order(last)
        return Queue(slots, links, pending, self.present, self.past, future)

    def at(self, offset: int) -> States | None:
        """Return the states at ``offset`` from the present, (d, n), as a fresh array, or None."""
        index = self.present + offset
        if not 0 <= index < len(self.slots):
            return None
        order, states = self._order(index), self.slots[index]
        return states.copy() if order is None else states.take(order, axis=1)

    def held(self, index: int) -> States:
        """Return the states of slot ``index``, (d, n); read-only, as they may be the queue's."""
        order, states = self._order(index), self.slots[index]
        return states if order is None else states.take(order, axis=1)

    def since(self, offset: int) -> list[States]:
        """Return ``at`` of each offset from ``offset`` ≥ 0 on, in one pass over the links."""
        order, found = self.pending, []
        for index in range(len(self.slots) - 1, self.present + offset - 1, -1):
            states = self.slots[index]
            found.append(states.copy() if order is None else states.take(order, axis=1))
            order = compose(self.links[index - 1], order) if index else order
        return found[::-1]

    def back(self, particles: Indices) -> Iterator[States]:
        """Yield the present states of some particles, (d, k), then those before them."""
        order = self._order(self.present)
        columns = particles if order is None else order[particles]
        for index in range(self.present, -1, -1):
            yield self.slots[index][:, columns]
            if index > 0 and (link := self.links[index - 1]) is not None:
                columns = link[columns]

    def _order(self, index: int) -> Link:
        """Return the map from the current order to that of slot ``index``."""
        if index == len(self.slots) - 1:
            return self.pending
        if index > self.present:
            return compose(self.future.composed(index - self.present), self.pending)
        order = compose(self.future.composed(), self.pending)
        return compose(self.past.composed(index), order) if index < self.present else order


def compose(outer: Link, inner: Link) -> Link:
    """Return the map i → outer[inner[i]]."""
    if outer is None:
        return inner
    return outer if inner is None else outer[inner]
