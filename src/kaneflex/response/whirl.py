"""Natural frequencies of rotors in fixed axes, with the direction of their whirl.

In axes that turn with the rotor a mode is Re(phi e^(i w t)). Across the axis of rotation, with unit vectors e_1 and
e_2, p = d.e_1 + i d.e_2 is A e^(i w t) + B e^(-i w t). In fixed axes p is multiplied by e^(i Omega t): A whirls at
Omega + w and B at Omega - w, forward if positive (Genta 2005, Dynamics of Rotating Systems, chapter 2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kaneflex.multibody.model.bound_model import Model, keep_terms
from kaneflex.multibody.time.linearisation import state_matrix
from kaneflex.response.elastic_motion import ElasticMotion

_MODES = 24
"""Number of modes checked, from the lowest frequency in rotating axes."""
_PURE = 0.99
"""Least share of a mode's squared amplitudes in one whirl direction, or along and about the axis."""
_SAME = 1e-9
"""Relative variation of matrices and angular velocities that counts as constant."""
_LOST = 1e-4
"""Share of the rotation speed below which a frequency in rotating axes is zero: at a critical speed, where the
deflection is constant in these axes and has no direction."""
_SMALL = 1e-9
"""Amplitudes [m or rad] of evaluated shapes, so that second-order effects vanish."""


@dataclass(frozen=True, eq=False)
class Whirl:
    """Modes of a rotor in fixed axes.

    Attributes
    ----------
    frequencies : ndarray (n_modes,)
        Natural frequencies [Hz].
    ways : ndarray of int (n_modes,)
        Whirl: 1 forward, with the rotation; -1 backward; 0 axial or torsional.
    """

    frequencies: np.ndarray
    ways: np.ndarray

    def of(self, way: int) -> np.ndarray:
        """Frequencies of one whirl direction, ascending [Hz]."""
        return np.sort(self.frequencies[self.ways == way])


def turns(model: Model) -> bool:
    """True if the axes of an elastic link, in which its coordinates are, rotate."""
    rigid = model.motion.at(np.linspace(0.0, model.options.duration, 5)[:-1])
    return any(np.any(rigid.frame(name).omega) for name in model.links)


def whirl(model: Model) -> Whirl | None:
    """Modes in fixed axes of a mechanism whose elastic links rotate steadily as one body.

    None if they don't, if the coefficients vary with the angle, if a mode diverges, or if a mode does not whirl in one
    direction, as of a blade or of a shaft with two different stiffnesses: it has several frequencies in fixed axes.
    """
    if model.in_space is None:
        return None
    rigid = model.motion.at(model.scene.period * np.array([0.0, 0.13, 0.41]))
    omega = np.array([rigid.frame(name).omega for name in model.links])
    spin = omega[0, :, 0]
    speed = float(np.linalg.norm(spin))
    terms = keep_terms(model.reduced, model.options._replace(damping=False))
    M, C, K = (rigid.matrices(terms[name]) for name in "MCK")
    varies = any(np.ptp(part, axis=0).max() > _SAME * abs(part).max() for part in (M, C, K))
    if varies or speed == 0.0 or abs(omega - spin[:, None]).max() > _SAME * speed:
        return None
    poles, vectors = np.linalg.eig(state_matrix(M[0], C[0], K[0]))
    found = np.concatenate([np.flatnonzero(poles.imag > 0.0), np.flatnonzero(poles.imag == 0.0)[::2]])  # one of a pair
    rising = found[np.argsort(poles.imag[found])][:_MODES]
    if abs(poles.real[rising]).max() > _LOST * speed:
        return None
    frequencies, ways = [], []
    all_shares = _shares(model, vectors[: len(M[0]), rising], spin / speed)
    for rate, shares in zip(poles.imag[rising], all_shares, strict=True):
        if rate < _LOST * speed:
            frequencies.append(speed)
            ways.append(1)
        elif shares.max() < _PURE * shares.sum():
            return None
        else:
            seen = (speed + rate, speed - rate, rate)[shares.argmax()]
            frequencies.append(abs(seen))
            ways.append(0 if shares.argmax() == 2 else int(math.copysign(1.0, seen)))
    return Whirl(np.array(frequencies) / (2.0 * np.pi), np.array(ways))


def _shares(model: Model, shapes: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Squared amplitudes of complex shapes (n, n_modes): of A, of B, and along and about the axis, (n_modes, 3).

    Rotations are multiplied by the links' lengths.
    """
    count = shapes.shape[1]
    rigid = model.motion.at(np.zeros(2 * count + 1))
    parts = np.hstack([shapes.real, shapes.imag, np.zeros((len(shapes), 1))]) * (_SMALL / abs(shapes).max())
    still = np.zeros_like(parts)
    motion = ElasticMotion(model, rigid, (parts, still, still))
    first = np.cross(axis, np.eye(3)[abs(axis).argmin()])
    first /= np.linalg.norm(first)
    basis = np.array([first, np.cross(axis, first), axis])
    found = np.zeros((count, 3))
    for name, link in model.links.items():
        for x in link.nodes:
            moved = motion.displacement(name, model.scene.vector((float(x), 0.0)))[0]
            moved = moved - moved[:, -1:]  # without the static deflection by loads
            for vector in (moved[:3], link.length * moved[3:]):
                seen = basis @ rigid.frame(name).to_global(vector)
                across, along, own = seen[:, :count] + 1j * seen[:, count:-1]
                found += np.array([abs(across + 1j * along) ** 2, abs(across - 1j * along) ** 2, 2 * abs(own) ** 2]).T
    return found
