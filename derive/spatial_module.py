"""Text of a module of a scene in space: courses of its drives and sizes of its loads.

Everything else of such a scene is numbers: the kernels of its bodies and joints are those of every scene
(``generated/spatial.py``), called according to tables.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from kaneflex.derive import module_text
from kaneflex.derive.coupled_module import courses_and_loads, laws_tables, printed
from kaneflex.derive.generate import operations_table
from kaneflex.derive.laws import Switches
from kaneflex.derive.mechanism import read_structure
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.scene.structure import structure_hash, structure_of


def generate_spatial(scene: Any, progress: Callable[[str], None] = lambda stage: None) -> str:
    """Text of the module for a scene's structure; equal structures give equal text."""
    progress("courses and loads")
    mechanism, switches = read_structure(structure_of(scene)), Switches()
    kernels, parameters = courses_and_loads(mechanism, switches)
    told = mechanism.names.told
    return module_text.module(
        "Drives and loads of a mechanism in space",
        ["Bodies, joints and springs are those of kaneflex.generated.spatial."],
        [
            *laws_tables(mechanism, parameters),
            module_text.literal("OBSERVED", told(tuple(mechanism.observed)), "joints that laws know beside them"),
            operations_table(emit.operations(kernels)),
        ],
        *printed(kernels, mechanism.names),
        structure=structure_hash(scene),
        made="kaneflex derive SCENE -o FILE.py",
    )
