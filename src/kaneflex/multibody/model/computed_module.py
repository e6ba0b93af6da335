"""Counterpart of a generated module for a system whose motion the engine computes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar


class ComputedModule:
    """Base of such modules: other attributes are those of the generated module of the system's laws."""

    system: Any
    CONSTANTS: ClassVar[Mapping[str, float]] = MappingProxyType({})
    LOOPS: ClassVar[tuple] = ()
    TERMS: ClassVar[tuple] = ()
    LINKS: ClassVar[tuple] = ()

    def __getattr__(self, name: str) -> object:
        if name.startswith("_") and name not in ("__name__", "__file__"):
            raise AttributeError(name)
        return getattr(self.system.module, name)
