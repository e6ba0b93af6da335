"""What a finished motion offers to whoever reads it: sensors, section forces, pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model import Model

if TYPE_CHECKING:
    from kaneflex.multibody.motion import CoupledMotion


class Motion(Protocol):
    """The motion of a model over some instants, whoever computed it.

    Attributes
    ----------
    model : Model
    times : ndarray (n_times,)
        Instants [s].
    rigid : RigidMotion
        The rigid motion at these instants, which displacements are measured from.
    coordinates : tuple of three ndarray (n, n_times)
        Elastic coordinates of the mechanism and their two rates.
    coupled : CoupledMotion or None
        Motion of all bodies, reactions and energies, under preset ``coupled``.
    """

    model: Model
    coupled: CoupledMotion | None

    @property
    def times(self) -> np.ndarray: ...

    @property
    def rigid(self) -> RigidMotion: ...

    @property
    def coordinates(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...

    def turned(self, body: str) -> np.ndarray:
        """Angle of a body in the rigid motion [rad], counted on from turn to turn."""
        ...
