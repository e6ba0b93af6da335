"""Integration of a motion that the drives do not prescribe: of free joints, and of coupled mechanisms in space.

Loading binds a scene and knows such a motion at its start only. A run integrates it, and whatever else reads the motion
asks for it here.
"""

from __future__ import annotations

from collections.abc import Callable

from kaneflex.multibody.model.bound_model import Model
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
    if model.options.dynamics == "coupled":
        from kaneflex.solve.coupled import simulate_coupled

        return _INTEGRATED.of(model, lambda: simulate_coupled(model, share).model)
    from kaneflex.solve.forward import integrate_free_joints

    return _INTEGRATED.of(model, lambda: integrate_free_joints(model, share))


def uncoupled(model: Model, share: Share = silent) -> Model:
    """As :func:`integrated` for models without coupling, whose equations need the motion; others unchanged."""
    return model if model.options.dynamics == "coupled" else integrated(model, share)
