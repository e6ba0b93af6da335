"""Sensors of a model in one file: an expression per sensor."""

from __future__ import annotations

from kaneflex.export import standalone_text as parts
from kaneflex.export.standalone_numbers import assigned, filled, in_lines
from kaneflex.export.standalone_points import Points, pair
from kaneflex.response.sensors import address_of
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import SECTION_KINDS, Sensor
from kaneflex.support.errors import SceneError

_RUN = "Use `kaneflex run`, or leave the sensor out"


class Expressions:
    """Expressions of sensors by the functions of the file."""

    def __init__(self, points: Points) -> None:
        self.points, self.scene, self.links = points, points.scene, points.links

    def of(self, name: str, sensor: Sensor) -> str:
        sections = sensor.kind in SECTION_KINDS
        read = self._section if sections else getattr(self, f"_{sensor.kind}", None)
        target = sensor.target
        if read is None or (sections and address_of(sensor).body not in self.links):
            raise SceneError(f"sensors.{name}", str(target), "the file does not support this sensor", _RUN)
        if isinstance(target, Address) and target.body in self.links:
            address = address_of(sensor)
            if self.points.node(address) is None or self.points.at(address)[1]:
                raise SceneError(f"sensors.{name}", str(target), "--standalone reads links at their nodes only",
                                 "Choose the elements so that a node lies there, or use `kaneflex run`")  # fmt: skip
        return read(sensor)

    def _in_axes(self, sensor: Sensor, body: str, vector: str) -> str:
        """Component of a global vector."""
        turned = f"(R[{body!r}][0].T @ {vector})" if sensor.axes == "body" else vector
        return f"{turned}[{'xy'.index(sensor.component)}]"

    def _place(self, address: Address) -> str:
        body, node = self.points.site(address)
        return f"place({body!r}, {node}, {self.points.at(address)})"

    def _turn(self, address: Address) -> str:
        body, node = self.points.site(address)
        return f"turn({body!r}, {node})"

    def _displacement(self, sensor: Sensor) -> str:
        address = address_of(sensor)
        body, node = self.points.site(address)
        index = ("x", "y", "angle").index(sensor.component)
        vector, ends = f"d[{body!r}][0, {node}]", f"d[{body!r}][0, {{}}]"
        start, end = ends.format(0), ends.format(-1)
        if body in self.links and sensor.relative_to == "start":
            vector = f"({vector} - {start})"
        elif body in self.links and sensor.relative_to == "chord":
            length = self.links[body].length
            if index == 2:
                return f"{vector}[2] - ({end} - {start})[1] / {length!r}"
            share = self.points.at(address)[0] / length
            vector = f"({vector} - {1.0 - share!r} * {start} - {share!r} * {end})"
        if sensor.axes != "body" and index < 2:
            vector = f"(R[{body!r}][0] @ {vector}[:2])"
        return f"{vector}[{index}]"

    def _position(self, sensor: Sensor) -> str:
        address = address_of(sensor)
        joint = self.scene.joints.get(address.body)
        if joint is None:
            return self._rate(sensor, 0)
        first, second = joint.addresses
        if joint.kind != "prismatic":
            return f"{self._turn(second)}[0] - {self._turn(first)}[0]"
        along = f"R[{first.body!r}][0] @ {pair(joint.direction)}"
        return f"({along}) @ ({self._place(second)} - {self._place(first)})[0]"

    def _rate(self, sensor: Sensor, order: int) -> str:
        address = address_of(sensor)
        if sensor.component == "angle":
            return f"{self._turn(address)}[{order}]"
        vector = f"{self._place(address)}[{order}]"
        if order == 2 and sensor.reading == "accelerometer" and any(self.scene.gravity):
            vector = f"({vector} - GRAVITY)"
        return self._in_axes(sensor, address.body, vector)

    def _velocity(self, sensor: Sensor) -> str:
        return self._rate(sensor, 1)

    def _acceleration(self, sensor: Sensor) -> str:
        return self._rate(sensor, 2)

    def _section(self, sensor: Sensor) -> str:
        """Section forces N, V, M at a node: of one adjacent element if something acts there, else the mean of both."""
        address = address_of(sensor)
        name, node = self.points.site(address)
        link = self.links[name]
        last, acted = len(link.nodes) - 1, {link.node_at(x) for x in self.scene.acted_on(name)}

        before, after = f"f[{name!r}][{node - 1}, 1]", f"-f[{name!r}][{node}, 0]"
        if node == 0 or (node in acted and sensor.cut == "after" and node < last):
            forces = after
        else:
            forces = before if node == last or node in acted else f"(({before} - f[{name!r}][{node}, 0]) / 2)"
        if sensor.kind == "strain":
            return f"{forces} @ (1 / LINKS[{name!r}][2], 0, {-float(sensor.fibre or 0.0)!r} / LINKS[{name!r}][3])"
        return f"{forces}[{('axial_force', 'shear_force', 'bending_moment').index(sensor.kind)}]"

    def _joint_force(self, sensor: Sensor) -> str:
        name = str(sensor.joint_force)
        first, second = (address.body for address in self.scene.joints[name].addresses)
        sign, force = "-" * (sensor.body == first), f"exerted[{name!r}]"
        if sensor.component == "angle":
            return f"{sign}{force}[2]"
        if sensor.axes == "body":
            force = f"{force}[:2]"
        return sign + self._in_axes(sensor, sensor.body or second, force)

    def _drive_torque(self, sensor: Sensor) -> str:
        return f"exerted[{str(sensor.target)!r}][2]"

    def _drive_force(self, sensor: Sensor) -> str:
        joint = self.scene.joints[str(sensor.target)]
        return f"exerted[{str(sensor.target)!r}][:2] @ R[{joint.addresses[0].body!r}][0] @ {pair(joint.direction)}"


def sensor_text(points: Points) -> str:
    """Text of the functions ``sensors`` and ``main``."""
    model, scene, expressions = points.model, points.scene, Expressions(points)
    rows = {name: expressions.of(name, sensor) for name, sensor in scene.sensors.items()}
    asked = "\n".join(rows.values())
    listed = in_lines(((f"{name!r}: {row}", scene.sensors[name].unit) for name, row in rows.items()), 12)
    angles = [name for name, row in rows.items() if "turn(" in row and scene.sensors[name].kind == "position"]
    lengths = [body.length for body in scene.bodies.values() if body.length]
    exerted = filled(
        parts.REACTIONS,
        joints=assigned("JOINTS", points.joints(), "axes, direction and kinds of reactions, and where they act"),
        length=repr(float(max(lengths))),
    ) if "exerted[" in asked else ""  # fmt: skip
    helpers = [text for name, text in parts.OF_POINTS.items() if f"{name}(" in asked]
    return exerted + filled(
        parts.SENSORS, exerted=parts.EXERTED * bool(exerted), helpers="".join(helpers), sensors=listed,
        displaced="shortened(L, q, z)" if model.options.foreshortening else "q",
    ) + filled(
        parts.MAIN, angles=filled(parts.ANGLES, names=repr(angles)) if angles else "",
        reference=repr(float(model.reference_time)),
    )  # fmt: skip
