"""The discrete event queue Q(t): states x_{t-L} … x_{t+F} of n particles, resampled by ancestry.

Resampling a queue does not copy its 2L + 1 states: each slot keeps the states as they were drawn
and a link, the index map from the order of the next slot's particles to its own. A state in
today's order is its slot's states taken at the composition of the links after it. The present
needs that at every step, so the composition over the future is kept by a sliding window.

Named tuples, because several of each are made at every step and they cost a fifth of a frozen
dataclass.
"""

from collections.abc import Sequence
from typing import NamedTuple

from deqmcl_gym.numerics.types import Indices
from localizers.inference.parts import States, made

Link = Indices | None  # None: the identity


class SlidingComposition(NamedTuple):
    """The composition of a window of links, pushed at its new end and popped at its old: O(1).

    Two stacks: the old half holds ready-made compositions from each link to the half's end, the
    new half one running composition. When the old half is used up, the new half is turned into it.
    """

    old: tuple[Link, ...] = ()  # next to be popped: last
    new: tuple[Link, ...] = ()
    running: Link = None

    def push(self, link: Link) -> "SlidingComposition":
        """Add the link of a new slot."""
        running = compose(self.running, link)
        return made(SlidingComposition, (self.old, (*self.new, link), running))

    def pop(self) -> "SlidingComposition":
        """Drop the oldest link."""
        if self.old:
            return SlidingComposition(self.old[:-1], self.new, self.running)
        if len(self.new) == 1:
            return _NOTHING
        turned: list[Link] = []
        for link in reversed(self.new):
            turned.append(compose(link, turned[-1] if turned else None))
        return SlidingComposition(old=tuple(turned[:-1]))

    def composed(self) -> Link:
        """Return the map from the newest slot's order to the oldest's."""
        return compose(self.old[-1], self.running) if self.old else self.running


_NOTHING = SlidingComposition()


class Queue(NamedTuple):
    """An immutable queue of slots, oldest first; ``present`` is the index of x_t among them."""

    slots: tuple[States, ...]
    links: tuple[Link, ...] = ()  # links[i]: from the order of slot i + 1 to that of slot i
    pending: Link = None  # from today's order to that of the newest slot
    present: int = 0
    future: SlidingComposition = SlidingComposition()

    @property
    def ahead(self) -> int:
        """How many states after the present are held."""
        return len(self.slots) - 1 - self.present

    def resampled(self, ancestors: Indices) -> "Queue":
        """Go on with these particles: whole queues, (n,)."""
        pending = compose(self.pending, ancestors)
        return made(Queue, (self.slots, self.links, pending, self.present, self.future))

    def appended(self, states: States) -> "Queue":
        """Add a newest state, (d, n)."""
        slots, links = (*self.slots, states), (*self.links, self.pending)
        return made(Queue, (slots, links, None, self.present, self.future.push(self.pending)))

    def advanced(self, states: States, past: int) -> "Queue":
        """Do ``appended`` and ``stepped`` in one, where nothing is held after the present."""
        if past == 0:
            return made(Queue, ((states,), (), None, 0, _NOTHING))
        drop = max(self.present + 1 - past, 0)
        slots, links = (*self.slots, states)[drop:], (*self.links, self.pending)[drop:]
        return made(Queue, (slots, links, None, self.present + 1 - drop, _NOTHING))

    def stepped(self, past: int) -> "Queue":
        """Let the next state become the present; keep at most ``past`` states before it."""
        drop = max(self.present + 1 - past, 0)
        slots, links, present = self.slots[drop:], self.links[drop:], self.present + 1 - drop
        return made(Queue, (slots, links, self.pending, present, self.future.pop()))

    def cut(self, keep: int) -> "Queue":
        """Forget the states more than ``keep`` after the present, today's order unchanged."""
        last = self.present + keep
        future = SlidingComposition()
        for link in self.links[self.present : last]:
            future = future.push(link)
        return Queue(
            self.slots[: last + 1], self.links[:last], self._order(last), self.present, future
        )

    def followed(self, future: Sequence[States]) -> "Queue":
        """Exchange the states after the present for others, (d, n) each, in today's order.

        They are stored as if drawn today, so that nothing links them to the order of the past.
        """
        present = self.cut(0)
        first, *later = present.appended(future[0]), *future[1:]
        kept = (None,) * len(later)
        links = SlidingComposition(new=(present.pending, *kept), running=present.pending)
        return first._replace(
            slots=(*first.slots, *later), links=(*first.links, *kept), future=links
        )

    def at(self, offset: int) -> States | None:
        """Return the states ``offset`` steps after the present (before it if negative), (d, n).

        None if the queue does not hold them. The array is fresh.
        """
        index = self.present + offset
        if not 0 <= index < len(self.slots):
            return None
        states = self.held(index)
        return states.copy() if states is self.slots[index] else states

    def held(self, index: int) -> States:
        """Return the states of slot ``index``, (d, n); to be read only, they may be the queue's."""
        newest = index == len(self.slots) - 1  # asked for at every step
        order = self.pending if newest else self._order(index)
        states = self.slots[index]
        return states if order is None else states.take(order, axis=1)

    def since(self, offset: int) -> list[States]:
        """Return the states from ``offset`` ≥ 0 steps after the present on, (d, n) each.

        As ``at`` of each, in one pass over the links.
        """
        order, found = self.pending, []
        for index in range(len(self.slots) - 1, self.present + offset - 1, -1):
            states = self.slots[index]
            found.append(states.copy() if order is None else states.take(order, axis=1))
            order = compose(self.links[index - 1], order) if index else order
        return found[::-1]

    def _order(self, index: int) -> Link:
        """Return the map from today's order to that of slot ``index``."""
        if index <= self.present:
            order = compose(self.future.composed(), self.pending)
            later = self.links[index : self.present]
        else:
            order, later = self.pending, self.links[index:]
        for link in reversed(later):
            order = compose(link, order)
        return order


def compose(outer: Link, inner: Link) -> Link:
    """Return the map i → outer[inner[i]]."""
    if outer is None:
        return inner
    return outer if inner is None else outer[inner]
