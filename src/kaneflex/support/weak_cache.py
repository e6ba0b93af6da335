"""Cache of values computed from immutable objects, for the lifetime of the object."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Generic, TypeVar

Owner = TypeVar("Owner")
Made = TypeVar("Made")


class WeakCache(Generic[Owner, Made]):
    """Cache of one value per object, for the object's lifetime; objects need not be hashable."""

    def __init__(self) -> None:
        self._made: dict[int, tuple[weakref.ref, Made]] = {}

    def of(self, owner: Owner, make: Callable[[], Made]) -> Made:
        """Value of the object; ``make`` computes it at the first request."""
        kept = self._made.get(id(owner))
        if kept is None or kept[0]() is not owner:
            key = id(owner)
            kept = self._made[key] = weakref.ref(owner, lambda _: self._made.pop(key, None)), make()
        return kept[1]
