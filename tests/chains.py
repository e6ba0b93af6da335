"""Chains of elastic links, each hinged to the one before: scenes whose equations grow with the number of links."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from kaneflex.scene import Scene, read_scene

_BEAM = 'beam = {E = "70 GPa", rho = "2700 kg/m^3", A = "100 mm^2", I = "800 mm^4"}'


def chain(count: int, closed: bool, folder: Path) -> Scene:
    """A chain of ``count`` links from a fixed point, all joints driven; or one that ends in a second fixed point, where
    the last two links follow the others.
    """
    links = [f"link_{k}" for k in range(1, count + 1)]
    hinged = [("ground", links[0]), *pairwise(links)]
    text = ["schema = 1", 'gravity = [0, "-9.81 m/s^2"]', f"ground = {{far = [{max(1, count - 1)}, 0]}}", "[bodies]"]
    text += [f"{link} = {{length = 1, {_BEAM}}}" for link in links]
    text += ["[joints]"]
    text += [
        f'pin_{k} = {{revolute = ["{first}{"" if first == "ground" else ".end"}", "{second}.start"]}}'
        for k, (first, second) in enumerate(hinged, 1)
    ]
    text += [f'far = {{revolute = ["{links[-1]}.end", "ground.far"]}}'] * closed
    text += ["[drives]"]
    text += [f'pin_{k} = {{law = "0.3 * sin({k} * t)"}}' for k in range(1, count + 1 - 2 * closed)]
    text += ["[solve]", "duration = 1"]
    path = folder / f"{'closed' if closed else 'open'}-chain-{count}.toml"
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return read_scene(path)
