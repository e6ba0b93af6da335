"""Integration of a motion that the drives do not prescribe: of free joints, and of coupled mechanisms in space.

Loading binds a scene and knows such a motion at its start only. A run integrates it, and whatever else reads the motion
asks for it here.
"""

from __future__ import annotations

from collections.abc import Callable

from kaneflex.mechanism.closure import check_closure
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import moving
from kaneflex.solve.law_checks import check_laws
from kaneflex.support.kept import Kept
from kaneflex.support.terminal import silent

Share = Callable[[float], None]
_INTEGRATED: Kept[Model, Model] = Kept()


def integrated(model: Model, share: Share = silent) -> Model:
    """The model with its motion over the run, integrated once per model; unchanged if the drives prescribe it.

    ``share`` is called with the finished share, 0 to 1.

    Raises SceneError if the motion can't continue; it names the time. That of a coupled mechanism then ends early.
    """
    if not model.awaits_run:
        return model
    if not model.scene.is_spatial:
        return _INTEGRATED.of(model, lambda: _in_plane(model, share))
    from kaneflex.solve.coupled import integrated_in_space

    return _INTEGRATED.of(model, lambda: integrated_in_space(model, share))


def uncoupled(model: Model, share: Share = silent) -> Model:
    """As :func:`integrated` for models without coupling, whose equations need the motion; others unchanged."""
    return model if model.options.dynamics == "coupled" else integrated(model, share)


def _in_plane(model: Model, share: Share) -> Model:
    from kaneflex.solve.forward import StartKinematics, integrate_free_joints

    mechanism, options, start = mechanism_of(model.scene), model.options, model.motion
    assert isinstance(start, StartKinematics)
    motion, energy = integrate_free_joints(mechanism, start, options, share)
    check_closure(mechanism, motion, options.duration)
    check_laws(model.scene, motion, options)
    return moving(model, motion, energy)
