"""Loops beyond dyads: positions by Newton's method, unrolled from a seed that is close already.

A group of bodies that the placed ones determine is spanned by a tree of its joints; the angle of a body behind a
revolute joint, or the slide behind a guide, is an unknown each, and the joints that are left close the loops. The seed
of every unknown is a table that the runtime's sweep over the drive's range fills: its cubics are so close that
``_ITERATIONS`` steps of Newton's method end in rounding (quadratic convergence; Stoer & Bulirsch 2002, 5.3). No memory
passes from one call to the next. A body's unknown angle is carried as its cosine and sine, so that it may turn around.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import sympy as sm

from kaneflex.derive.equations.linear import determinant, solve_blocks
from kaneflex.derive.equations.mechanism import SymbolicMechanism
from kaneflex.derive.ir.functions import table
from kaneflex.derive.ir.program import Steps
from kaneflex.mechanism.joints import demanded
from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.planar import BodyPoint, Pose, Vector, cross, dot, minus

_ITERATIONS = 2


@dataclass(frozen=True)
class Loop:
    """A group of bodies that is closed by Newton's method.

    Attributes
    ----------
    bodies, joints : tuple of str
        The group, and the joints that hold it.
    closing : str
        The joint that the loop is named after: the last one that closes one.
    turning : tuple of str
        Bodies whose angles are unknowns.
    sliding : tuple of str
        Guides whose slides are.
    """

    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    closing: str
    turning: tuple[str, ...]
    sliding: tuple[str, ...]


@dataclass(frozen=True)
class Closed:
    """A closed loop: poses of its bodies, the margin that must stay positive, and what is left of the gaps."""

    loop: Loop
    poses: dict[str, Pose]
    margin: sm.Expr
    gap: sm.Expr


def close_group(
    mechanism: SymbolicMechanism,
    drive_angle: Mapping[str, sm.Expr],
    poses: Mapping[str, Pose],
    against: sm.Expr,
    steps: Steps,
) -> Closed | None:
    """Close the smallest group of bodies that joints and drives determine; None where there is none.

    ``against`` is what the seeds' tables are read at.
    """
    group = mechanism.smallest_group(poses, [name for name in mechanism.bodies if name not in poses])
    if not group:
        return None
    joints = [joint.name for joint in mechanism.joints_of(poses, group)]
    tree = _Tree(mechanism, drive_angle, poses, group)
    closing = [name for name in joints if mechanism.joints[name].closes_loop] or joints
    loop = Loop(group, tuple(joints), closing[-1], tuple(tree.turning), tuple(tree.sliding))
    residuals = [
        row
        for name in joints
        if name not in tree.joints
        for row in tree.residuals(mechanism.joints[name], drive_angle.get(name))
    ]
    unknowns = [*loop.turning, *loop.sliding]
    jacobian = [[tree.derivative(residual, unknown) for unknown in unknowns] for residual in residuals]
    values = _seeds(mechanism, tree, loop, against, steps)

    def now(name: str, expression: sm.Expr) -> sm.Expr:
        """Value at the current unknowns."""
        return steps.assign(name, expression.xreplace(values))

    for turn in range(_ITERATIONS):
        changes = [sm.Symbol(f"change_{name}_{turn}") for name in unknowns]
        rows = []
        for k, residual in enumerate(residuals):
            row = now(f"gap_{loop.closing}_{k}_{turn}", residual)
            for j, change in enumerate(changes):
                row += now(f"slope_{loop.closing}_{k}_{j}_{turn}", jacobian[k][j]) * change
            rows.append((f"{loop.closing}.{k}", row))
        solved = solve_blocks(rows, changes, steps)
        values = _moved(tree, loop, values, [solved[change] for change in changes], turn, steps)
    size = len(residuals), len(unknowns)
    matrix = sm.Matrix(*size, lambda k, j: now(f"slope_{loop.closing}_{k}_{j}_", jacobian[k][j]))
    side = mechanism.parameter(f"joints.{loop.closing}.side", "1")
    margin = steps.assign(f"closure_{loop.closing}", side * determinant(matrix))
    left = [now(f"left_{loop.closing}_{k}", residual) for k, residual in enumerate(residuals)]
    gap = steps.assign(f"gap_{loop.closing}", sm.sqrt(sum(residual**2 for residual in left)))
    found = {}
    for name in group:
        pose = tree.frames[name]
        c, s = now(f"c_{name}", pose.c), now(f"s_{name}", pose.s)
        found[name] = Pose(now(f"x_{name}", pose.x), now(f"y_{name}", pose.y), c, s)
    return Closed(loop, found, margin, gap)


def hung(
    joint: Joint,
    frames: Mapping[str, Pose],
    coordinate: sm.Expr | None,
    assign: Callable[[sm.Symbol, sm.Expr], sm.Expr] = lambda symbol, value: value,
) -> tuple[BodyPoint, Vector, tuple[sm.Expr, sm.Expr]]:
    """Connection of a joint to the body that has a frame: the point of the other body, its position, and that body's
    direction.

    ``coordinate`` is the angle or the slide of the joint's second body relative to the first; None: the direction of
    the body with the frame.
    """
    forward = joint.first.body in frames
    base, body = (joint.first, joint.second) if forward else (joint.second, joint.first)
    frame, sign = frames[base.body], 1 if forward else -1
    at, c, s = frame.place(base.at), frame.c, frame.s
    if coordinate is not None and joint.kind == "prismatic":
        along = frame.turn(joint.direction)
        at = tuple(at[k] + sign * coordinate * along[k] for k in range(2))
    elif coordinate is not None:
        cosine = assign(f"cos_{joint.name}", sm.cos(coordinate))
        sine = assign(f"sin_{joint.name}", sm.sin(coordinate))
        c, s = c * cosine - sign * s * sine, s * cosine + sign * c * sine
    return body, at, (c, s)


class _Tree:
    """Poses of a group's bodies in terms of its unknowns: symbols for cosines, sines and slides."""

    def __init__(self, mechanism: Mechanism, drive_angle, poses: Mapping[str, Pose], group: tuple[str, ...]) -> None:
        self.frames = dict(poses)
        self.joints: list[str] = []
        self.turning: list[str] = []
        self.sliding: list[str] = []
        self.cosine = {name: sm.Symbol(f"cosine_of_{name}") for name in group}
        self.sine = {name: sm.Symbol(f"sine_of_{name}") for name in group}
        self.slide = {name: sm.Symbol(f"slide_of_{name}") for name in mechanism.joints}
        while not {*group} <= {*self.frames}:
            name = self._next(mechanism, group)
            self._attach(mechanism.joints[name], drive_angle.get(name), name in mechanism.drives)
            self.joints.append(name)

    def _next(self, mechanism: Mechanism, group: tuple[str, ...]) -> str:
        """A joint from a body with a frame to one without; first those that add no unknown."""
        waiting = {name: {*joint.bodies} - {*self.frames} for name, joint in mechanism.joints.items()}
        open_ones = [name for name, bodies in waiting.items() if len(bodies) == 1 and bodies <= {*group}]
        fixed = [name for name in open_ones if name in mechanism.drives or mechanism.joints[name].kind == "weld"]
        return (fixed or open_ones)[0]

    def _attach(self, joint: Joint, coordinate: sm.Expr | None, driven: bool) -> None:
        if joint.kind == "weld":
            coordinate = joint.angle
        elif joint.kind == "prismatic" and not driven:
            self.sliding.append(joint.name)
            coordinate = self.slide[joint.name]
        body, at, (c, s) = hung(joint, self.frames, coordinate)
        if coordinate is None:
            self.turning.append(body.body)
            c, s = self.cosine[body.body], self.sine[body.body]
        dx, dy = Pose(sm.S.Zero, sm.S.Zero, c, s).turn(body.at)
        self.frames[body.body] = Pose(at[0] - dx, at[1] - dy, c, s)

    def residuals(self, joint: Joint, coordinate: sm.Expr | None) -> list[sm.Expr]:
        """Loop residuals of a joint outside the tree, and of its drive: lengths and sines of angles."""
        first, second = self.frames[joint.first.body], self.frames[joint.second.body]
        gap, along = minus(second.place(joint.second.at), first.place(joint.first.at)), first.turn(joint.direction)

        def turned_beyond(angle: sm.Expr) -> sm.Expr:
            """The sine of how far the second body is turned against the first beyond an angle."""
            axes, others = (first.c, first.s), (second.c, second.s)
            return cross(axes, others) * sm.cos(angle) - dot(axes, others) * sm.sin(angle)

        rows = [*demanded(joint, gap, turned_beyond(joint.angle), along)]
        if coordinate is None:
            return rows
        return [*rows, dot(along, gap) - coordinate if joint.slides else turned_beyond(coordinate)]

    def derivative(self, residual: sm.Expr, unknown: str) -> sm.Expr:
        """By a body's angle, (c, s)' = (-s, c), or by a guide's slide."""
        if unknown in self.sliding:
            return residual.diff(self.slide[unknown])
        c, s = self.cosine[unknown], self.sine[unknown]
        return c * residual.diff(s) - s * residual.diff(c)


def _seeds(
    mechanism: SymbolicMechanism, tree: _Tree, loop: Loop, against: sm.Expr, steps: Steps
) -> dict[sm.Symbol, sm.Expr]:
    def read(name: str, what: str) -> sm.Expr:
        begins = mechanism.parameter(f"{'joints' if what == 'slide' else 'bodies'}.{name}.seed_{what}", "1")
        return steps.assign(f"seed_{name}_{what}", table(against, begins))

    values = {tree.slide[name]: read(name, "slide") for name in loop.sliding}
    for name in loop.turning:
        c, s = read(name, "c"), read(name, "s")
        size = steps.assign(f"size_{name}", sm.sqrt(c**2 + s**2))
        values[tree.cosine[name]] = steps.assign(f"c_{name}_0", c / size)
        values[tree.sine[name]] = steps.assign(f"s_{name}_0", s / size)
    return values


def _moved(tree: _Tree, loop: Loop, values, changes: list[sm.Expr], turn: int, steps: Steps) -> dict:
    """The unknowns after a step of Newton's method; a cosine and its sine turn by the angle's change."""
    moved, of = {}, dict(zip((*loop.turning, *loop.sliding), changes, strict=True))
    for name in loop.sliding:
        slide = tree.slide[name]
        moved[slide] = steps.assign(f"slide_{name}_{turn + 1}", values[slide] + of[name])
    for name in loop.turning:
        c, s = values[tree.cosine[name]], values[tree.sine[name]]
        dc = steps.assign(f"dc_{name}_{turn}", sm.cos(of[name]))
        ds = steps.assign(f"ds_{name}_{turn}", sm.sin(of[name]))
        moved[tree.cosine[name]] = steps.assign(f"c_{name}_{turn + 1}", c * dc - s * ds)
        moved[tree.sine[name]] = steps.assign(f"s_{name}_{turn + 1}", s * dc + c * ds)
    return moved
