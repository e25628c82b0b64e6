"""The values that this session of Blender stored in projects, and that undo may store again. Does not import bpy.

A *place* is one thing that a project stores: its measurement, the Gaussians of an object, a name, a record. Undo and
redo show an earlier or later value of a place in Blender. It is stored again where this session led from that value to
the one that is stored now, and no other program has stored anything since.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any


class StateHistory:
    """The values of each place of projects that this session has stored or seen, without those of other programs."""

    def __init__(self) -> None:
        self._last: dict[Hashable, Any] = {}
        self._chains: dict[tuple[Hashable, Any], int] = {}
        self._refused: set[tuple[Hashable, Any]] = set()
        self._count = 0

    def remember(self, place: Hashable, before: Any, after: Any) -> None:
        """Remember that this session stored `after`, where Blender had shown `before`. Both are hashable."""
        chain = self._chains.get((place, before))
        if chain is None:
            self._count += 1
            chain = self._count
        self._chains[place, before] = self._chains[place, after] = chain
        self._last[place] = after

    def agree(self, place: Hashable, value: Any) -> None:
        """Note that Blender and the project have the same `value` of a place that every value may follow in."""
        self._last[place] = value

    def last(self, place: Hashable, otherwise: Any = None) -> Any:
        """Return what this session stored or agreed to last; `otherwise` where it did neither."""
        return self._last.get(place, otherwise)

    def leads_to(self, place: Hashable, wanted: Any) -> bool:
        """Return whether this session led from `wanted` to what it stored last, or the other way."""
        if place not in self._last:
            return False
        chain = self._chains.get((place, self._last[place]))
        return chain is not None and self._chains.get((place, wanted)) == chain

    def names_of(self, project: Hashable, kind: str) -> list[str]:
        """Return the names of the places ``(project, name, kind)`` in which this session has stored something."""
        return [one[1] for one in self._last if isinstance(one, tuple) and (one[0], one[2]) == (project, kind)]

    def waits(self, place: Hashable, wanted: Any, *, always: bool = False) -> bool:
        """Return whether `follow` would look into the project."""
        if place not in self._last or wanted == self._last[place] or (place, wanted) in self._refused:
            return False
        return always or self.leads_to(place, wanted)

    def follow(
        self,
        place: Hashable,
        wanted: Any,
        stored: Any,
        store: Callable[[Any], None],
        *,
        always: bool = False,
    ) -> bool:
        """Store `wanted`, which Blender shows now, in the place where `stored` is.

        Parameters
        ----------
        stored : hashable
            What the project has at this moment.
        store : callable
            Called with `wanted`.
        always : bool
            Whether any value that Blender shows may be stored, not only one that this session came from.

        Returns
        -------
        bool
            Whether the project keeps another value, which another program has stored; returned once for each `wanted`.
        """
        if not self.waits(place, wanted, always=always):
            return False
        if stored != wanted:
            if stored != self._last[place]:
                self._refused.add((place, wanted))
                return True
            store(wanted)
        self._last[place] = wanted
        self._refused = {one for one in self._refused if one[0] != place}
        return False

    def refuse(self, place: Hashable, wanted: Any) -> None:
        """Do not try to store `wanted` again: it cannot be done, and the user knows."""
        self._refused.add((place, wanted))

    def clear(self) -> None:
        """Forget everything: undo does not reach behind the loading of a file."""
        self._last.clear()
        self._chains.clear()
        self._refused.clear()
