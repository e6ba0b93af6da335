"""What is computed of an object that does not change, kept as long as that lives."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Generic, TypeVar

Owner = TypeVar("Owner")
Made = TypeVar("Made")


class Kept(Generic[Owner, Made]):
    """One thing for each object: made once, given again while the object lives, whether it can be hashed or not."""

    def __init__(self) -> None:
        self._made: dict[int, tuple[weakref.ref, Made]] = {}

    def of(self, owner: Owner, make: Callable[[], Made]) -> Made:
        """What was made of the object; by ``make`` where it is asked for the first time."""
        kept = self._made.get(id(owner))
        if kept is None or kept[0]() is not owner:
            key = id(owner)
            kept = self._made[key] = weakref.ref(owner, lambda _: self._made.pop(key, None)), make()
        return kept[1]
