"""Energy of a motion, and how well it balances: of the coupled equations, and of the rigid mechanism."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.mechanism.rigid_motion import Motion, RigidMotion
from kaneflex.scene import Scene

_CHUNK = 1000
"""Steps whose scalars are held at a time."""


@dataclass(frozen=True, eq=False)
class Energy:
    """Energy of the mechanism at some instants [J], each of shape (n_times,).

    ``stored`` is kinetic, strain and potential energy together; ``dissipated`` by damping and ``supplied`` by loads and
    prescribed drives since the start.
    """

    kinetic: np.ndarray
    strain: np.ndarray
    weight: np.ndarray
    dissipated: np.ndarray
    supplied: np.ndarray

    @property
    def stored(self) -> np.ndarray:
        return self.kinetic + self.strain + self.weight

    @property
    def gap(self) -> np.ndarray:
        """Stored + dissipated - supplied, less what was stored at first: zero for an exact solution."""
        return self.stored - self.stored[0] + self.dissipated - self.supplied

    @property
    def drift(self) -> float:
        """Largest gap against the largest energy that was turned over."""
        turned = max(
            float(np.ptp(part)) for part in (self.kinetic, self.strain, self.weight, self.dissipated, self.supplied)
        )
        return float(abs(self.gap).max()) / turned if turned else 0.0


def rigid_energy(scene: Scene, motion: Motion, times: np.ndarray, pieces: int) -> Energy:
    """Energy of the rigid mechanism at the ends of an integration's steps.

    Parameters
    ----------
    times : ndarray (n_steps * pieces + 1,)
        Instants [s] that cut each step into ``pieces`` equal ones. Works are integrated over a step by the closed
        Newton-Cotes rule through all of them, so that next to the integration itself it leaves no error.
    """
    from scipy.integrate import newton_cotes

    weights, _ = newton_cotes(pieces)
    energies, works = [], [np.zeros((2, 1))]
    for first in range(0, len(times) - 1, _CHUNK * pieces):
        rigid = motion.at(times[first : first + _CHUNK * pieces + 1])
        ends = np.array(_state(scene, rigid))[:, ::pieces]
        energies.append(ends if first == 0 else ends[:, 1:])
        powers = np.array([_dissipation(scene, rigid), _supply(scene, rigid)])
        rows = np.arange(ends.shape[1] - 1)[:, None] * pieces + np.arange(pieces + 1)
        works.append(powers[:, rows] @ weights * np.diff(rigid.times)[::pieces])
    return Energy(*np.concatenate(energies, axis=1), *np.cumsum(np.concatenate(works, axis=1), axis=1))


def _state(scene: Scene, rigid: RigidMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kinetic energy, that of the springs and that of the weight [J]."""
    kinetic, strain, weight = np.zeros((3, len(rigid.times)))
    parts = [(name, body.mass, body.inertia, body.centre) for name, body in scene.bodies.items()]
    parts += [(lump.at.body, lump.mass, lump.inertia, scene.point(lump.at)) for lump in scene.masses.values()]
    for body, mass, inertia, at in parts:
        place, velocity = _point(rigid, body, at)
        kinetic += mass * (velocity**2).sum(0) / 2 + inertia * _spin(rigid, body) ** 2 / 2
        weight -= mass * (np.array(scene.gravity) @ place)
    for name, spring in scene.springs.items():
        stretch = rigid[f"{name}.length"] - spring.length if spring.ends else rigid[f"{name}.angle"] - spring.angle
        strain += spring.stiffness * stretch**2 / 2
    return kinetic, strain, weight


def _dissipation(scene: Scene, rigid: RigidMotion) -> np.ndarray:
    """Power of all dampers [W]: c L'^2, where c L' is the spring's force less that of its stiffness."""
    total = np.zeros(len(rigid.times))
    for name, spring in scene.springs.items():
        if spring.damping:
            force, now, free = "tension", "length", spring.length
            if not spring.ends:
                force, now, free = "torque", "angle", spring.angle
            drag = rigid[f"{name}.{force}"] - spring.stiffness * (rigid[f"{name}.{now}"] - free)
            total += drag**2 / spring.damping
    return total


def _supply(scene: Scene, rigid: RigidMotion) -> np.ndarray:
    """Power of loads and prescribed drives [W]."""
    total = np.zeros(len(rigid.times))
    for name, load, at, share in (push for body in scene.bodies for push in scene.pushes(body)):
        _, velocity = _point(rigid, at.body, scene.point(at))
        axes = "ground" if load.axes == "global" else at.body
        total += share * rigid[name] * (_turned(rigid, axes, load.direction) * velocity).sum(0)
    for name, load in scene.torques.items():
        total += rigid[name] * _relative_spin(scene, rigid, load.torque_at)
    for name, drive in scene.drives.items():
        if not drive.free:
            speed = _sliding(scene, rigid, name) if scene.slides(name) else _relative_spin(scene, rigid, name)
            total += rigid[f"{name}.drive"] * speed
    return total


def _spin(rigid: RigidMotion, body: str) -> np.ndarray:
    return np.zeros(len(rigid.times)) if body == "ground" else rigid[f"{body}.omega"]


def _relative_spin(scene: Scene, rigid: RigidMotion, joint: str) -> np.ndarray:
    """Angular velocity of a joint's second body against its first [rad/s]."""
    first, second = (_spin(rigid, address.body) for address in scene.joints[joint].addresses)
    return second - first


def _sliding(scene: Scene, rigid: RigidMotion, joint: str) -> np.ndarray:
    """Speed of what slides along its guide [m/s]; the guide's turn moves it across only, as it lies on the guide."""
    guide, slider = scene.joints[joint].addresses
    velocity = [_point(rigid, address.body, scene.point(address))[1] for address in (guide, slider)]
    return ((velocity[1] - velocity[0]) * _turned(rigid, guide.body, scene.joints[joint].direction)).sum(0)


def _turned(rigid: RigidMotion, body: str, vector: tuple[float, float]) -> np.ndarray:
    """Global components of a body-fixed vector, (2, n_times)."""
    if body == "ground":
        return np.outer(vector, np.ones(len(rigid.times)))
    c, s = rigid[f"{body}.c"], rigid[f"{body}.s"]
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def _point(rigid: RigidMotion, body: str, at: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Place [m] and velocity [m/s] of a body-fixed point, (2, n_times) each."""
    arm = _turned(rigid, body, at)
    if body == "ground":
        return arm, np.zeros_like(arm)
    start, velocity = (np.array([rigid[f"{body}.{x}"], rigid[f"{body}.{y}"]]) for x, y in ("xy", ("v_x", "v_y")))
    return start + arm, velocity + rigid[f"{body}.omega"] * np.array([-arm[1], arm[0]])
