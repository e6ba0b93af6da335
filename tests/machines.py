"""Mechanisms that many tests move, as TOML texts of scenes, in the plane or in space.

Each builder takes the insides of the entries for its bodies and its drive, and all other tables by their names: a text
with an entry a line, a mapping of plain values as for ``solve``, or a single value as for gravity. Entries are written
with their full names, ``bodies.bar = {...}``: a test adds others at the end.
``more`` continues entries of joints; ``title`` names the scene. In space (``deep``) joints turn about z, the normal of
the plane.
"""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

PLAIN = ("ground", "damping")
"""Tables of plain values."""
WEIGHT = [0, "-9.81 m/s^2"]
"""Gravity in the plane."""
STRIP = 'length = "0.3 m", beam = {material = "steel", section = {rectangle = ["4 mm", "20 mm"]}}'
"""Inside of the entry for a body that bends easily in the plane."""


JOINT = re.compile(r"(\w+) (\S+) ([^\s,]+)(.*)")
"""Kind and both sides of a joint, and the rest of its entry."""
SENSOR = re.compile(r"(\w+) ([^\s,]+)(?: (\w+))?(.*)")
"""Kind, target and component of a sensor, and the rest of its entry."""


def _value(value: Any) -> str:
    """A value in TOML; tables are inline."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_value(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value)


def _inside(table: str, of: str) -> str:
    """Inside of an entry, of a joint or a sensor perhaps by its short form."""
    if table == "joints" and (joint := JOINT.fullmatch(of)) and joint[2] != "=":
        return f'{joint[1]} = ["{joint[2]}", "{joint[3]}"]{joint[4]}'
    if table == "sensors" and (sensor := SENSOR.fullmatch(of)) and sensor[2] != "=":
        return f'{sensor[1]} = "{sensor[2]}"' + f', component = "{sensor[3]}"' * bool(sensor[3]) + sensor[4]
    return of


def machine(**tables: Any) -> str:
    """Text of a scene by its tables.

    A table of bodies, joints, sensors and so on has the insides of entries by names. Joints and sensors have a short
    form, which a comma and the rest of the entry may follow: "revolute ground crank.start", "position rod.end x".
    """
    lines = ["schema = 1"]
    for table, entries in tables.items():
        if isinstance(entries, str) and table not in ("name", "description", "like"):
            lines += [f"{table}.{line}" for line in entries.splitlines() if line]
        elif isinstance(entries, Mapping) and table != "solve":
            raw = table not in PLAIN
            lines += [
                f"{table}.{name} = " + (f"{{{_inside(table, of)}}}" if raw and isinstance(of, str) else _value(of))
                for name, of in entries.items()
            ]
        else:
            lines.append(f"{table} = {_value(entries)}")
    return "\n".join(lines) + "\n"


def text(bodies: Mapping[str, str], joints: Mapping[str, str], drives: Mapping[str, str], **tables: Any) -> str:
    """Text of a scene; see the module for ``tables``."""
    more, title = tables.pop("more", {}), tables.pop("title", None)
    joined = {name: f"{of}, {more[name]}" if name in more else of for name, of in joints.items()}
    named = {} if title is None else {"name": title}
    if isinstance(solve := tables.get("solve"), Mapping):  # by lines, which others may follow
        tables["solve"] = "\n".join(f"{key} = {_value(value)}" for key, value in solve.items())
    return machine(**named, bodies=bodies, joints=joined, drives=drives, **tables)


def changed(of: str, *changes: tuple[str, str]) -> str:
    """A text whose old parts, each of which must be there, are new ones; an empty old part adds a line at the end."""
    for old, new in changes:
        assert old in of, old
        of = of.replace(old, new) if old else f"{of}{new}\n"
    return of


def _pin(first: str, second: str, deep: bool, kind: str = "revolute") -> str:
    """Inside of the entry for a joint between two points, which turns about the normal of the plane."""
    return f'{kind} = ["{first}", "{second}"]' + ", axis = [0, 0, 1]" * (deep and kind == "revolute")


def cantilever(bar: str, body: str = "bar", root: str = "root", **tables: Any) -> str:
    """A body that is clamped to the ground."""
    return text({body: bar}, {root: f'weld = ["ground", "{body}.start"]'}, {}, **tables)


def on_supports(beam: str, **tables: Any) -> str:
    """A body on a pin at its start and a light roller at its end."""
    bodies = {"beam": beam, "roller": 'mass = "1e-6 kg"'}
    joints = {"pin": _pin("ground", "beam.start", False), "support": _pin("beam.end", "roller", False)}
    return text(bodies, joints | {"floor": 'prismatic = ["ground", "roller"], direction = [1, 0]'}, {}, **tables)


def pendulum(bar: str, drive: str, body: str = "bar", hinge: str = "hinge", deep: bool = False, **tables: Any) -> str:
    """A body on a hinge, free or driven."""
    return text({body: bar}, {hinge: _pin("ground", f"{body}.start", deep)}, {hinge: drive}, **tables)


def slider_crank(
    crank: str, rod: str, slider: str, drive: str, body: str = "piston", guide: str = "bore",
    wrist: str = "revolute", deep: bool = False, **tables: Any,
) -> str:  # fmt: skip
    """Crank on the driven joint `main`, rod on `pin`, slider on `wrist` of this kind and on its guide along x."""
    joints = {
        "main": _pin("ground", "crank.start", deep), "pin": _pin("crank.end", "rod.start", deep),
        "wrist": _pin("rod.end", f"{body}.start", deep, wrist),
        guide: f'prismatic = ["ground", "{body}.start"], direction = [1, 0{", 0" * deep}]',
    }  # fmt: skip
    return text({"crank": crank, "rod": rod, body: slider}, joints, {"main": drive}, **tables)


def four_bar(
    crank: str, coupler: str, rocker: str, drive: str, far: str,
    names: Sequence[str] = ("main", "pin", "knee", "foot"), deep: bool = False, **tables: Any,
) -> str:  # fmt: skip
    """Crank, coupler and rocker on joints of these names, of which the fourth is on the ground's point ``far``.

    The loop is closed by the last of them, or by one whose entry ``more`` continues with a branch.
    """
    ends = [("ground", "crank.start"), ("crank.end", "coupler.start"), ("coupler.end", "rocker.end")]
    ends.append((f"ground.{far}", "rocker.start"))
    joints = {name: _pin(*each, deep) for name, each in zip(names, ends, strict=True)}
    for name in tables.get("more", {}):
        joints[name] = joints.pop(name)
    return text({"crank": crank, "coupler": coupler, "rocker": rocker}, joints, {names[0]: drive}, **tables)


def block(of: str, drive: str, body: str = "block", slide: str = "slide", **tables: Any) -> str:
    """A body on a guide along x."""
    guide = f'prismatic = ["ground", "{body}.start"], direction = [1, 0]'
    return text({body: of}, {slide: guide}, {slide: drive}, **tables)


def scotch_yoke(drive: str, run: Mapping[str, Any], more: str = "", **tables: Any) -> str:
    """Crank, a block without mass on its pin, and a yoke on a rail along x: the loop alone says how the block turns.

    ``run``: entries for ``solve`` beside the preset; ``more``: sensors beside the angle phi of the crank.
    """
    bodies = {"crank": 'length = "50 mm", mass = "1 kg"', "block": "", "yoke": 'mass = "2 kg"'}
    joints = {
        "main": _pin("ground", "crank", False), "rail": 'prismatic = ["ground", "yoke"], direction = [1, 0]',
        "slot": 'prismatic = ["yoke", "block"], direction = [0, 1]', "pin": _pin("crank.end", "block", False),
    }  # fmt: skip
    tables |= {"sensors": f'phi = {{position = "main", component = "angle"}}\n{more}'}
    return text(bodies, joints, {"main": drive}, solve={"preset": "coupled", "tolerance": 1e-9, **run}, **tables)


FREE_CRANK = 'free = true, angle = 0.4, initial_speed = "20 rad/s"'
ABSORBER = """
schema = 1
description = "A pendulum on a turning crank, held by a spring: nothing deforms, a joint is free"
gravity = [0, "-9.81 m/s^2"]
bodies = {crank = {length = "100 mm", mass = "1 kg"}, bob = {length = "80 mm", mass = "0.2 kg"}}
joints = {main = {revolute = ["ground", "crank"]}, swing = {revolute = ["crank.end", "bob"]}}
drives = {main = {speed = "300 rpm", cycle = "360 deg"}, swing = {free = true, angle = "10 deg"}}
sensors = {swing = {position = "swing", component = "angle"}, speed = {velocity = "bob", component = "angle"}}
springs.hold = {torsional_at = "swing", stiffness = "0.5 N m/rad", damping = "1.2e-3 N m s/rad"}
solve = {preset = "coupled", start = "periodic", steps = 360, tolerance = 1e-7}
"""


BALL_ON_PLANE = machine(
    description="A ball above a plane", gravity=[0, 0, -9.81],
    bodies=dict(ball="mass = 2, inertia = [0.01, 0.01, 0.01], free = {at = [0, 0, 0], velocity = [0.3, -0.2, 0.5]}"),
    ground=dict(foot=[0.2, 0.1, -0.4]),
    contacts=dict(floor='point_on_plane = ["ball", "ground.foot"], normal = [1, 2, 5], radius = "50 mm", '
                        'contact = CONTACT'),
    sensors=dict(push="contact_force floor", room="contact_gap floor"),
    solve=dict(preset="coupled", duration="0.4 s", steps=100, tolerance=1e-10),
)
