"""Counterpart of a generated module for a mechanism whose motion the engine computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

from kaneflex.multibody.model.system import System


@dataclass(frozen=True, eq=False)
class ComputedModule:
    """Mechanism by names of its tabulated scalars; other attributes are those of the generated module of its laws.

    Attributes
    ----------
    system : System
    open_reactions : frozenset of str
        In space, statically indeterminate reactions, which are NaN.
    more : tuple
        Name, unit and meaning of further scalars for elastic bodies.
    CONSTANTS : mapping of str to float
        Those of them that are zero by structure.
    """

    system: System
    open_reactions: frozenset[str] = frozenset()
    more: tuple[tuple[str, str, str], ...] = ()
    CONSTANTS: Mapping[str, float] = field(default_factory=dict)
    LOOPS: ClassVar[tuple] = ()
    TERMS: ClassVar[tuple] = ()
    LINKS: ClassVar[tuple] = ()

    def __getattr__(self, name: str) -> object:
        if name.startswith("_") and name not in ("__name__", "__file__"):
            raise AttributeError(name)
        return getattr(self.system.module, name)

    @property
    def FREE(self) -> tuple[str, ...]:
        """Free joints, then free bodies, in the plane their coordinates."""
        return self.system.mechanism.free

    @cached_property
    def SCALARS(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and meaning of the tabulated scalars.

        In the plane without reactions, since a coupled mechanism may pass positions where those of the rigid one are
        infinite.
        """
        system, forces = self.system, () if self.system.in_space else self.system.constraints
        slides = [system.mechanism.joints[name].kind == "prismatic" for name in self.coordinates]
        found = [(f"{name}.angle", "m" if slide else "rad", "coordinate of the joint")
                 for name, slide in zip(self.coordinates, slides, strict=True)]  # fmt: skip
        found += [(name, each.unit, each.meaning) for name, each in system.scalars.items()
                  if name not in forces]  # fmt: skip
        return (*found, *self.more)

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Joints with tabulated coordinates: in the plane the driven ones, in space those of the tree with one
        coordinate, driven, free and observed ones.

        With several freedoms it is the first, for a cylindrical joint its rotation; for a ball the angle of its
        rotation, from 0 to pi.
        """
        mechanism, tree = self.system.mechanism, self.system.layout.tree
        if not self.system.in_space:
            return tuple(mechanism.drives)
        known = {*mechanism.drives, *mechanism.read}
        return tuple(
            name
            for name, joint in mechanism.joints.items()
            if (joint.freedoms == 1 and name in tree) or (name in known and joint.freedoms)
        )
