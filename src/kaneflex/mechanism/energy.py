"""Energy balance of a motion, of the coupled equations or of the rigid mechanism."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.mechanism import springs
from kaneflex.mechanism.parts import Joint, Mechanism, Spring
from kaneflex.mechanism.planar import GROUND, dot
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion

_CHUNK = 1000
"""Number of steps whose scalars are in memory at a time."""
LARGEST_JUMP = 1e-3
"""Loss between two instants, as a share of the energy exchanged, that is not an error of steps: ten times the loss of
a whole run without a warning."""
_LEAST_TURNED = 1e-3
"""Smallest exchange that counts, as a share of the existing energy: a torque-free body exchanges only rounding and
integration errors."""


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
        """Balance stored + dissipated - supplied - initially stored: zero for an exact solution."""
        return self.stored - self.stored[0] + self.dissipated - self.supplied

    @property
    def turned(self) -> float:
        """Largest energy exchanged, or at least a small share of the existing energy."""
        parts = (self.kinetic, self.strain, self.weight, self.dissipated, self.supplied)
        largest = max(float(abs(part).max()) for part in (self.kinetic, self.strain))
        return max(*(float(np.ptp(part)) for part in parts), _LEAST_TURNED * largest)

    @property
    def drift(self) -> float:
        """Largest gap relative to the energy exchanged."""
        turned = self.turned
        return float(abs(self.gap).max()) / turned if turned else 0.0

    def jumps(self, share: float = LARGEST_JUMP) -> np.ndarray:
        """Instants before those at which the gap has changed by more than a share of the energy exchanged."""
        return np.flatnonzero(abs(np.diff(self.gap)) > share * self.turned)


def rigid_energy(mechanism: Mechanism, motion: RigidKinematics, times: np.ndarray, pieces: int) -> Energy:
    """Energy of the rigid mechanism at the ends of an integration's steps.

    Parameters
    ----------
    times : ndarray (n_steps * pieces + 1,)
        Instants [s] that divide each step into ``pieces`` equal parts. Works are integrated over a step by the closed
        Newton-Cotes rule through all of them, whose error is negligible beside that of the integration.
    """
    from scipy.integrate import newton_cotes

    weights, _ = newton_cotes(pieces)
    energies, works = [], [np.zeros((2, 1))]
    for first in range(0, len(times) - 1, _CHUNK * pieces):
        rigid = motion.at(times[first : first + _CHUNK * pieces + 1])
        ends = np.array(_state(mechanism, rigid))[:, ::pieces]
        energies.append(ends if first == 0 else ends[:, 1:])
        powers = np.array([_dissipation(mechanism, rigid), _supply(mechanism, rigid)])
        rows = np.arange(ends.shape[1] - 1)[:, None] * pieces + np.arange(pieces + 1)
        works.append(powers[:, rows] @ weights * np.diff(rigid.times)[::pieces])
    return Energy(*np.concatenate(energies, axis=1), *np.cumsum(np.concatenate(works, axis=1), axis=1))


def _state(mechanism: Mechanism, rigid: RigidMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kinetic energy, energy of springs and potential of weight [J]."""
    parts = [(name, body.mass, body.inertia, body.centre) for name, body in mechanism.bodies.items()]
    parts += [(lump.point.body, lump.mass, lump.inertia, lump.point.at) for lump in mechanism.masses.values()]
    kinetic, strain, weight = np.zeros((3, len(rigid.times)))
    for body, mass, inertia, at in parts:
        frame = rigid.frame(body)
        kinetic += 0.5 * (mass * (frame.velocity(at) ** 2).sum(axis=0) + inertia * frame.omega**2)
        weight -= mass * (mechanism.gravity @ frame.place(at))
    for spring in mechanism.springs.values():
        strain += springs.potential(spring, _stretched(rigid, spring))
    return kinetic, strain, weight


def _stretched(rigid: RigidMotion, spring: Spring) -> np.ndarray:
    """Length [m] or angle [rad] of a spring."""
    return rigid[f"{spring.name}.{'length' if spring.ends else 'angle'}"]


def _dissipation(mechanism: Mechanism, rigid: RigidMotion) -> np.ndarray:
    """Power of all dampers [W]: c L'^2, where c L' is the spring's tension minus that of its stiffness."""
    total = np.zeros(len(rigid.times))
    for name, spring in mechanism.springs.items():
        if spring.damping:
            tension = rigid[f"{name}.{'tension' if spring.ends else 'torque'}"]
            total += (tension - springs.tension(spring, _stretched(rigid, spring))) ** 2 / spring.damping
    return total


def _supply(mechanism: Mechanism, rigid: RigidMotion) -> np.ndarray:
    """Power of loads and prescribed drives [W]."""
    total = np.zeros(len(rigid.times))
    for name, load in mechanism.loads.items():
        for point, share in load.pushes:
            axes = rigid.frame(GROUND if load.axes == "global" else point.body)
            velocity = rigid.frame(point.body).velocity(point.at)
            total += share * rigid[name] * dot(axes.to_global(load.direction), velocity)
        if load.joint is not None:
            total += rigid[name] * _relative_spin(rigid, mechanism.joints[load.joint])
    for name, drive in mechanism.drives.items():
        if not drive.free:
            joint = mechanism.joints[name]
            total += rigid[f"{name}.drive"] * (_sliding if joint.slides else _relative_spin)(rigid, joint)
    return total


def _relative_spin(rigid: RigidMotion, joint: Joint) -> np.ndarray:
    """Angular velocity of a joint's second body relative to its first [rad/s]."""
    first, second = (rigid.frame(body).omega for body in joint.bodies)
    return second - first


def _sliding(rigid: RigidMotion, joint: Joint) -> np.ndarray:
    """Speed of a slider along its guide [m/s]; rotation of the guide moves it only across."""
    first, second = (rigid.frame(side.body).velocity(side.at) for side in joint.sides)
    return dot(second - first, rigid.frame(joint.first.body).to_global(joint.direction))
