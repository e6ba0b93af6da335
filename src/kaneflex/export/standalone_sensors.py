"""Sensors of a model in one file: equilibrium for the joints' reactions, and an expression per sensor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple, cast

from kaneflex.export import standalone_text as parts
from kaneflex.export.standalone_numbers import LINE, filled, number, short, wrapped
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.sensors import address_of
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import SECTION_KINDS, Sensor
from kaneflex.support.errors import SceneError

_LUMPS = "for to, on, m, J, at, push in "
_SIDES = "for row, sign, column, units, arm in "
_RUN = "Use `kaneflex run`, or leave the sensor out"


Pair = tuple[float, float]


class Lump(NamedTuple):
    """A mass at a point of a body: mass, inertia, position, and the point's L if deformation moves it."""

    body: str
    m: str
    J: str
    at: Pair
    to: str | None

    def inertia(self, moved: bool = False) -> str:
        """Text of m (a - g) and J epsilon, with the elastic motion if ``moved``."""
        more = f", product({self.to}, z)" if moved and self.to is not None else ""
        return f"inertia(s, {self.body!r}, {self.m}, {self.J}, {short(self.at)}{more})"


def pair(values: Sequence[float] | None) -> Pair:
    """Two components of a planar vector."""
    assert values is not None
    x, y = values
    return float(x), float(y)


class Texts:
    """Expressions of a model's points, loads and masses; ``s``, ``L``, ``z``, ``d``, ``w``, ``f``, ``r`` as in the
    file."""

    def __init__(self, model: Model) -> None:
        assert model.frame is not None and model.interfaces is not None  # there are elastic links
        self.model, self.scene, self.links = model, model.scene, model.links
        self.frame, self.interfaces = model.frame, model.interfaces
        self.guided = tuple(model.frame.bodies)
        self.less_gravity = " - GRAVITY" * any(self.scene.gravity)

    def at(self, address: Address) -> Pair:
        return pair(self.scene.point(address))

    def node(self, address: Address) -> int | None:
        return self.links[address.body].node_at(self.at(address)[0]) if address.body in self.links else None

    def rotated(self, body: str, vector: Pair) -> str:
        """Global components of a vector in a body's axes."""
        return f"R[{body!r}][0] @ {short(vector)}" if body != "ground" else f"np.array({short(vector)})"

    def motion(self, address: Address) -> str | None:
        """Global L of a point's displacement and rotation; None if deformation does not move it."""
        body, node = address.body, self.node(address)
        if node is not None:
            return f"node_map(s, {body!r}, L[{body!r}], {node})"
        return f"L[{body!r}]" if body in self.guided else None

    def force(self, name: str) -> str:
        """Global force of a load, with zero moment."""
        load = self.scene.forces[name]
        direction = pair(load.direction)
        if load.axes == "global":
            return f"s[{name!r}] * np.array({short((*direction, 0.0))})"
        body = cast(Address, load.force_on).body
        return f"s[{name!r}] * np.append(frame(s, {body!r})[1][0] @ {short(direction)}, 0)"

    def masses(self, body: str, node: int | None = None) -> Iterator[Lump]:
        """Masses fixed to a rigid body, or to a link's node."""
        data = self.scene.bodies[body]
        if node is None and (data.mass or data.inertia):
            to = f"L[{body!r}]" if body in self.guided else None
            yield self._lump(f"bodies.{body}", body, (data.mass, data.inertia), pair(data.centre), to)
        for name, mass in self.scene.masses.items():
            if mass.at.body == body and self.node(mass.at) == node:
                numbers = mass.mass, mass.inertia
                yield self._lump(f"masses.{name}", body, numbers, self.at(mass.at), self.motion(mass.at))

    def _lump(self, key: str, body: str, numbers: tuple[Any, Any], at: Pair, to: str | None) -> Lump:
        m, J = (number(self.model, f"{key}.{of}", x) for of, x in zip(("mass", "inertia"), numbers, strict=True))
        return Lump(body, m, J, at, to)

    def loads(self, body: str, node: int | None) -> list[str]:
        """Loads on a rigid body or on a link's node."""
        on = {name: load.force_on for name, load in self.scene.forces.items()}
        return [name for name, at in on.items() if at is not None and (at.body, self.node(at)) == (body, node)]

    def lumps(self) -> str:
        """Rows of points that deformation moves: L, body, mass, inertia, position, load."""
        sites: list[tuple[str, int | None]] = [(body, None) for body in self.guided]
        sites += [(name, k) for name, link in self.links.items() for k in range(len(link.nodes))]
        rows = []
        for body, node in sites:
            pushes = self.loads(body, node)
            lumps = list(self.masses(body, node)) or ([Lump(body, "0", "0", (0.0, 0.0), None)] if pushes else [])
            for k, lump in enumerate(lumps):
                to = f"L[{body!r}]" if node is None else f"node_map(s, {body!r}, L[{body!r}], {node})"
                push = " + ".join(map(self.force, pushes)) if pushes and not k else "0"
                rows.append(f"({to}, {body!r}, {lump.m}, {lump.J}, {short(lump.at)}, {push})")
        return wrapped(_LUMPS, rows, indent=4).removeprefix(f"    {_LUMPS}")

    def place(self, address: Address) -> str:
        """Global position of a displaced point with its rates."""
        body, node = address.body, self.node(address)
        if body == "ground":
            return f"np.array(({short(self.at(address))}, (0, 0), (0, 0)))"
        rigid = f"point(s, {body!r}, {short(self.at(address))})"
        if node is not None:
            return f"{rigid} + product(R[{body!r}], d[{body!r}][:, {node}, :2])"
        return rigid + f" + product(L[{body!r}], w)[:, :2]" * (body in self.guided)

    def turn(self, address: Address, order: int) -> str:
        """Angle of a body at a point, or a rate of it."""
        body, node = address.body, self.node(address)
        if body == "ground":
            return "0.0"
        rigid = (f"math.atan2(s[{f'{body}.s'!r}], s[{f'{body}.c'!r}])", f"s[{f'{body}.omega'!r}]",
                 f"s[{f'{body}.epsilon'!r}]")[order]  # fmt: skip
        return rigid if node is None else f"{rigid} + d[{body!r}][{order}, {node}, 2]"


class Reactions:
    """Unknown reactions of all joints: columns, and the equilibrium of nodes at joints and of rigid bodies."""

    def __init__(self, texts: Texts) -> None:
        self.texts, self.scene = texts, texts.scene
        self.columns: dict[str, int] = {}
        count = 0
        for name, joint in self.scene.joints.items():
            self.columns[name] = count
            count += {"revolute": 2, "weld": 3, "prismatic": 2}[joint.kind] + (name in self.scene.drives)
        self.count = count
        nodes = texts.interfaces.displaced
        self.sites = [
            (body, node)
            for body in self.scene.bodies
            for node in ([k for name, k in nodes if name == body] if body in texts.links else [None])
        ]

    def text(self) -> str:
        lengths = [body.length for body in self.scene.bodies.values() if body.length]
        return filled(
            parts.REACTIONS, rows=3 * len(self.sites), columns=self.count, balances="\n".join(self._balances()),
            sides=self._sides(), length=repr(float(max(lengths))),
        )  # fmt: skip

    def _balances(self) -> Iterator[str]:
        for k, (body, node) in enumerate(self.sites):
            terms = list(self._terms(body, node))
            if terms:
                rows = f"    b[{3 * k}:{3 * k + 3}] = "
                line = rows + " ".join(terms).removeprefix("+ ")
                if len(line) > LINE:
                    line = f"{rows}({f'{chr(10)}{chr(32) * len(rows)} '.join(terms).removeprefix('+ ')})"
                yield line
        for name, joint in self.scene.joints.items():
            if joint.kind == "prismatic":
                carrier, (x, y) = joint.addresses[0].body, pair(joint.direction)
                along = f", {short((x, y, 0.0))}" * (name in self.scene.drives)
                yield f"    {self.guide(name)} = np.array(({short((0.0 - y, x, 0.0))}{along}, (0, 0, 1)), dtype=float)"
                if carrier != "ground":
                    yield f"    {self.guide(name)}[:, :2] = {self.guide(name)}[:, :2] @ R[{carrier!r}][0].T"

    def _terms(self, body: str, node: int | None) -> Iterator[str]:
        """Signed terms of an equilibrium: element end forces, inertia, loads."""
        texts = self.texts
        if node is not None:
            if node < len(texts.links[body].nodes) - 1:
                yield f"+ g[{body!r}][{node}, 0]"
            if node:
                yield f"+ g[{body!r}][{node - 1}, 1]"
        for lump in texts.masses(body, node):
            yield f"+ {self._about(body, node, lump.at, lump.inertia(moved=True))}"
        for name in texts.loads(body, node):
            at = texts.at(cast(Address, self.scene.forces[name].force_on))
            yield f"- {self._about(body, node, at, texts.force(name))}"

    def _about(self, body: str, node: int | None, at: Pair, push: str) -> str:
        """Force with its moment about a rigid body's start, or about the node that it acts on."""
        direct = node is not None or at == (0.0, 0.0)
        return push if direct else f"about({self.texts.rotated(body, at)}, {push})"

    def guide(self, name: str) -> str:
        """Name of a guide's unit reactions."""
        return f"guide_{list(self.scene.joints).index(name) + 1}"

    def _sides(self) -> str:
        """Row of the equilibrium, sign, first column, unit reactions and their arm, for both sides of every joint."""
        texts, rows = self.texts, []
        for name, joint in self.scene.joints.items():
            units = self.guide(name) if joint.kind == "prismatic" else "np.eye(3)"
            if joint.kind == "revolute" and name not in self.scene.drives:
                units = "np.eye(2, 3)"
            for address, sign in zip(joint.addresses, (-1, 1), strict=True):
                if address.body != "ground":
                    row = 3 * self.sites.index((address.body, texts.node(address)))
                    arm = self._arm(address, joint.addresses[1] if joint.kind == "prismatic" else address)
                    rows.append(f"({row}, {sign}, {self.columns[name]}, {units}, {arm})")
        return wrapped(_SIDES, rows, indent=4).removeprefix(f"    {_SIDES}")

    def _arm(self, address: Address, touched: Address) -> str:
        body, at = address.body, self.texts.at(touched)
        if body in self.texts.links or (touched.body == body and at == (0.0, 0.0)):
            return "(0, 0)"
        if touched.body == body:
            return self.texts.rotated(body, at)
        place = f"point(s, {touched.body!r}, {short(at)})[0]" if touched.body != "ground" else f"np.array({short(at)})"
        return f"{place} - frame(s, {body!r})[0][0]"

    def force(self, name: str) -> tuple[str, str]:
        """Global components of a joint's force on its second side."""
        joint, column = self.scene.joints[name], self.columns[name]
        if joint.kind != "prismatic":
            return f"r[{column}]", f"r[{column + 1}]"
        units = range(1 + (name in self.scene.drives))
        x, y = (" + ".join(f"r[{column + j}] * {self.guide(name)}[{j}, {i}]" for j in units) for i in range(2))
        return x, y

    def moment(self, name: str) -> str:
        joint, column = self.scene.joints[name], self.columns[name]
        if joint.kind == "revolute":
            return f"r[{column + 2}]" if name in self.scene.drives else "0.0"
        return f"r[{column + 2 if joint.kind == 'weld' else column + 1 + (name in self.scene.drives)}]"

    def drive(self, name: str) -> str:
        return f"r[{self.columns[name] + (2 if self.scene.joints[name].kind == 'revolute' else 1)}]"


class Expressions:
    """Expression for each sensor of a scene."""

    def __init__(self, texts: Texts, reactions: Reactions) -> None:
        self.texts, self.scene, self.reactions = texts, texts.scene, reactions
        self.named: dict[tuple[str, str], str] = {}

    def names(self) -> str:
        """Statements of expressions that several sensors read."""
        found = []
        for kind in ("place", "cut"):
            rows = [f"{key!r}: {text}" for (of, key), text in self.named.items() if of == kind]
            found += [wrapped(f"{kind} = ", rows, "{}", indent=4)] if rows else []
        return "".join(f"{line}\n" for line in found)

    def _name(self, kind: str, key: str, text: str) -> str:
        self.named[kind, key] = text
        return f"{kind}[{key!r}]"

    def _place(self, address: Address) -> str:
        return self._name("place", f"{address.body}.{address.point}", self.texts.place(address))

    def of(self, name: str, sensor: Sensor) -> str:
        sections = sensor.kind in SECTION_KINDS
        read = self._section if sections else getattr(self, f"_{sensor.kind}", None)
        target = sensor.target
        if read is None or (sections and address_of(sensor).body not in self.texts.links):
            raise SceneError(f"sensors.{name}", str(target), "the file does not support this sensor", _RUN)
        of_link = isinstance(target, Address) and target.body in self.texts.links
        if of_link and (self.texts.node(address_of(sensor)) is None or self.texts.at(address_of(sensor))[1]):
            raise SceneError(f"sensors.{name}", str(target), "--standalone reads links at their nodes only",
                             "Choose the elements so that a node lies there, or use `kaneflex run`")  # fmt: skip
        return read(sensor)

    def _component(self, sensor: Sensor, body: str, vector: str) -> str:
        if sensor.axes == "body" and body != "ground":
            vector = f"(R[{body!r}][0].T @ {vector})"
        return f"{vector}[{'xy'.index(sensor.component)}]"

    def _displacement(self, sensor: Sensor) -> str:
        texts, address = self.texts, address_of(sensor)
        body, node = address.body, texts.node(address)
        index = ("x", "y", "angle").index(sensor.component)
        if node is None:
            moved = f"product(L[{body!r}], w)[0, :2]" if body in texts.guided else "np.zeros(2)"
            vector = f"np.append(R[{body!r}][0].T @ {moved}, 0.0)"
        else:
            vector, share = f"d[{body!r}][0, {node}]", texts.at(address)[0] / texts.links[body].length
            if sensor.relative_to == "start":
                vector = f"({vector} - d[{body!r}][0, 0])"
            elif sensor.relative_to == "chord" and index == 2:
                chord = f"d[{body!r}][0, -1, 1] - d[{body!r}][0, 0, 1]"
                return f"d[{body!r}][0, {node}, 2] - ({chord}) / {texts.links[body].length!r}"
            elif sensor.relative_to == "chord":
                vector = f"({vector} - {1.0 - share!r} * d[{body!r}][0, 0] - {share!r} * d[{body!r}][0, -1])"
        if sensor.axes != "body" and index < 2:
            vector = f"(R[{body!r}][0] @ {vector}[:2])"
        return f"{vector}[{index}]"

    def _position(self, sensor: Sensor) -> str:
        texts, address = self.texts, address_of(sensor)
        joint = self.scene.joints.get(address.body)
        if joint is None:
            if sensor.component == "angle":
                return texts.turn(address, 0)
            return self._component(sensor, address.body, f"{self._place(address)}[0]")
        first, second = joint.addresses
        if joint.kind != "prismatic":
            before = texts.turn(first, 0)
            return texts.turn(second, 0) + ("" if before == "0.0" else f" - ({before})")
        along = texts.rotated(first.body, pair(joint.direction))
        along = f"({along})" if "@" in along else along
        return f"{along} @ ({self._place(second)} - {self._place(first)})[0]"

    def _velocity(self, sensor: Sensor, order: int = 1) -> str:
        address = address_of(sensor)
        if sensor.component == "angle":
            return self.texts.turn(address, order)
        vector = f"{self._place(address)}[{order}]"
        if order == 2 and sensor.reading == "accelerometer":
            vector = f"({vector}{self.texts.less_gravity})" if self.texts.less_gravity else vector
        return self._component(sensor, address.body, vector)

    def _acceleration(self, sensor: Sensor) -> str:
        return self._velocity(sensor, 2)

    def _section(self, sensor: Sensor) -> str:
        """Section forces N, V, M at a node: of one adjacent element if something acts there, else the mean of both."""
        address = address_of(sensor)
        link, node = self.texts.links[address.body], self.texts.node(address)
        assert node is not None  # checked before
        f, last = f"f[{link.name!r}]", len(link.nodes) - 1
        acted = {link.node_at(x) for x in self.scene.acted_on(link.name)}

        before, after = f"{f}[{node - 1}, 3:]", f"-{f}[{node}, :3]"
        if node == 0 or (node in acted and sensor.cut == "after" and node < last):
            forces = after
        else:
            forces = before if node == last or node in acted else f"({before} - {f}[{node}, :3]) / 2"
        cut = self._name("cut", f"{link.name}.{address.point}{', after' * (forces == after)}", forces)
        if sensor.kind == "strain":
            return f"{cut}[0] / LINKS[{link.name!r}][2] - {sensor.fibre!r} * {cut}[2] / LINKS[{link.name!r}][3]"
        return f"{cut}[{('axial_force', 'shear_force', 'bending_moment').index(sensor.kind)}]"

    def _joint_force(self, sensor: Sensor) -> str:
        name = str(sensor.joint_force)
        first, second = (address.body for address in self.scene.joints[name].addresses)
        sign = "-" if sensor.body == first else ""
        if sensor.component == "angle":
            return f"{sign}({self.reactions.moment(name)})".replace("(r[", "r[").replace("])", "]")
        force, on = self.reactions.force(name), sensor.body or second
        if sensor.axes == "body" and on != "ground":
            return sign + self._component(sensor, on, f"np.array([{', '.join(force)}])")
        found = force["xy".index(sensor.component)]
        return f"-({found})" if sign else found

    def _drive_torque(self, sensor: Sensor) -> str:
        return self.reactions.drive(str(sensor.target))

    _drive_force = _drive_torque


def _in_lines(rows: Iterable[tuple[str, str]]) -> str:
    """Dictionary of entries with their units; entries of one unit share lines."""
    lines: list[tuple[str, str]] = []
    for row, unit in rows:
        if lines and lines[-1][1] == unit and len(lines[-1][0]) + len(row) + len(unit) < LINE - 18:
            lines[-1] = f"{lines[-1][0]} {row},", unit
        else:
            lines.append((f"{row},", unit))
    text = "\n".join(f"{' ' * 12 * (k > 0)}{line}  # {unit}" for k, (line, unit) in enumerate(lines))
    last = text.rindex(",  # ")
    return f"{{{text[:last]}}}{text[last + 1 :]}"


def sensor_text(texts: Texts) -> str:
    """Text of the functions ``sensors`` and ``main``."""
    model, scene, reactions = texts.model, texts.scene, Reactions(texts)
    expressions = Expressions(texts, reactions)
    rows = {name: expressions.of(name, sensor) for name, sensor in scene.sensors.items()}
    asked = "".join((*rows.values(), *expressions.named.values()))
    angles = tuple(name for name, text in rows.items() if "math.atan2" in text)
    plain = "    d, w = {link: each.reshape(3, -1, 3) for link, each in q.items()}, z"
    balances = reactions.text() if "r[" in asked else ""
    bodies = tuple(scene.bodies)
    text = filled(
        parts.SENSORS, bodies=repr(bodies), g=", g" * bool(balances), empty=", {}" * bool(balances),
        displaced="    d, w = shortened(L, q, z)" if model.options.foreshortening else plain,
        reactions=balances, turned=parts.TURNED * bool(balances), names=expressions.names(),
        sensors=_in_lines((f"{name!r}: {row}", scene.sensors[name].unit) for name, row in rows.items()),
    )  # fmt: skip
    unwrapped = filled(parts.ANGLES, names=repr(angles)) if angles else ""
    return text + filled(parts.MAIN, angles=unwrapped, reference=repr(float(model.reference_time)))
