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


def bars(count: int, folder: Path, angle: float = -30.0, duration: float = 0.5, damping: float = 0.0) -> Scene:
    """A strip of 1 m and 1 kg as a chain of rigid bars on pins with torsional springs of E I = 0.5 N m^2, released
    straight and at rest at an angle [deg] under its weight.
    """
    h, E_I = 1.0 / count, 0.5
    names = [f"bar_{k}" for k in range(1, count + 1)]
    text = ["schema = 1", 'gravity = [0, "-9.81 m/s^2"]', "[bodies]"]
    text += [f"{name} = {{length = {h!r}, mass = {h!r}}}" for name in names]
    text += ["[joints]", f'pin_1 = {{revolute = ["ground", "{names[0]}.start"]}}']
    text += [f'pin_{k} = {{revolute = ["{a}.end", "{b}.start"]}}' for k, (a, b) in enumerate(pairwise(names), 2)]
    text += ["[drives]", f'pin_1 = {{free = true, angle = "{angle} deg"}}']
    text += [f'pin_{k} = {{free = true, angle = "0 deg"}}' for k in range(2, count + 1)]
    text += ["[springs]"] * (count > 1)
    text += [
        f'spring_{k} = {{torsional_at = "pin_{k}", stiffness = {E_I / h!r}, damping = {damping!r}}}'
        for k in range(2, count + 1)
    ]
    text += ["[sensors]", f'tip_x = {{position = "{names[-1]}.end", component = "x"}}']
    text += [f'tip_y = {{position = "{names[-1]}.end", component = "y"}}']
    text += ['pull = {joint_force = "pin_1", component = "x"}']
    text += ["[solve]", 'preset = "coupled"', f"duration = {duration!r}", "steps = 200", "tolerance = 1e-7"]
    path = folder / f"bars-{count}.toml"
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return read_scene(path)
