"""``python -m kaneflex.derive [-o FOLDER]``: write the modules that all scenes share and those of shipped scenes.

The default folder is ``generated/``.
"""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

from kaneflex.derive.bodies.kernels import shapes_text, spatial_shapes_text
from kaneflex.derive.elements.plane import element_texts
from kaneflex.derive.elements.space import spatial_element_texts
from kaneflex.derive.generate import generate
from kaneflex.derive.laws.contact import contact_text
from kaneflex.derive.laws.drives_and_loads import generate_laws
from kaneflex.derive.laws.friction import friction_text
from kaneflex.derive.laws.joints import joints_text, spatial_text
from kaneflex.derive.printers.functions_text import laws_text, tables_text
from kaneflex.derive.printers.module_text import COMPILING
from kaneflex.derive.printers.rows import rows_text
from kaneflex.scene import read_scene, shipped_scenes
from kaneflex.scene.structure import laws_hash, structure_hash

SCENES = (
    "elastic-double-pendulum", "engine", "four-bar", "four-bar-motor", "mathieu", "pulsating-strut",
    "rotating-cantilever", "slider-crank-150", "slider-crank-150-coupled", "slider-crank-clearance",
    "spatial-slider-crank-elastic", "spinning-top",
)  # fmt: skip
"""Scenes that the README, the documentation and the benchmarks run; other modules are derived at their first use."""
INDEX = '''"""Modules of kaneflex: elements, bodies, joints, tables, scenes. Do not edit: ``make derive`` makes them."""

# Structure hash -> module. Scenes of one structure share a module.
STRUCTURES = {{
{entries}}}
'''


def modules() -> dict[str, str]:
    """File name -> text of everything in ``generated/``."""
    texts = element_texts() | spatial_element_texts()
    texts |= {"tables": tables_text(), "laws": laws_text()}
    texts |= {"compiling": COMPILING, "rows": rows_text()}
    texts |= {"joints": joints_text(), "spatial": spatial_text()}
    texts |= {"shapes": shapes_text(), "spatial_shapes": spatial_shapes_text()}
    texts |= {"contact": contact_text(), "friction": friction_text()}
    structures: dict[str, str] = {}
    for name in sorted({*SCENES} & {*shipped_scenes()}):
        scene = read_scene(name)
        laws = scene.is_spatial or scene.solve.preset == "coupled"
        structure = (laws_hash if laws else structure_hash)(scene)
        if structure not in structures:
            structures[structure] = name.replace("-", "_") + "_laws" * laws
            texts[structures[structure]] = (generate_laws if laws else generate)(scene)
    entries = "".join(f'    "{key}": "{module}",\n' for key, module in structures.items())
    texts["__init__"] = INDEX.format(entries=entries)
    return {f"{name}.py": text for name, text in texts.items()}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m kaneflex.derive", description=__doc__)
    here = Path(find_spec("kaneflex.generated").origin).parent
    parser.add_argument("-o", "--output", type=Path, default=here, help="folder to write into")
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    texts = modules()  # all before any is written, so that a failure leaves the folder unchanged
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
        print(f"wrote {folder / name}")
    if folder == here:
        for orphan in sorted(set(path.name for path in folder.glob("*.py")) - set(texts)):
            (folder / orphan).unlink()
            print(f"removed {folder / orphan}")


if __name__ == "__main__":
    main()
