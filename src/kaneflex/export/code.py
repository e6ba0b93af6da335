"""Equations of a scene as text: LaTeX, modules of Python, and C."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, overload

from kaneflex.scene.options import resolve_options
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError, nearest
from kaneflex.support.terminal import silent

Progress = Callable[[str], None]
FORMS = ("module", "pruned", "standalone", "c")


@takes(scene="scene", progress="function")
def equations(scene: SceneLike, progress: Progress | None = None) -> str:
    """Equations of a planar scene as a LaTeX document: the rigid motion and the element's matrices.

    Raises
    ------
    SceneError
        For a scene in space, and where drives and joints do not determine the motion.
    """
    from kaneflex.scene.option_check import refuse_in_space

    scene, progress = scene_from(scene), progress or silent
    refuse_in_space(scene, "equations", "LaTeX equations exist for")
    progress("importing SymPy")
    from kaneflex.derive.latex import latex
    from kaneflex.mechanism.mechanism import mechanism_of
    from kaneflex.multibody.model.module_loading import derivable

    with derivable(mechanism_of(scene)):
        return latex(scene, progress)


@overload
def derive_code(scene: SceneLike, form: Literal["c"], progress: Progress | None = None) -> dict[str, str]: ...
@overload
def derive_code(
    scene: SceneLike, form: Literal["module", "pruned", "standalone"] = "module", progress: Progress | None = None
) -> str: ...
@takes(scene="scene", form="text", progress="function")
def derive_code(scene: SceneLike, form: str = "module", progress: Progress | None = None) -> str | dict[str, str]:
    """Equations of a scene as a Python module, or as C.

    Parameters
    ----------
    scene : Scene, Model, Solution or path
        The equations of preset ``coupled`` differ from those that all other presets share.
    form : {"module", "pruned", "standalone", "c"}
        "module" is the numba module of the scene's structure, without its numbers; "pruned" has only the terms of the
        scene's preset; "standalone" is the whole model in one readable file; "c" is a folder of portable C11.
    progress : callable, optional
        Called with the name of each stage.

    Returns
    -------
    str or dict of str to str
        Text of the module; for "c" the text of each file by its name.

    Raises
    ------
    SceneError
        If drives and joints do not determine the motion, or the form does not support the scene.
    """
    scene, progress = scene_from(scene), progress or silent
    if form not in FORMS:
        raise SceneError("form", form, "no such form of the equations", nearest(form, FORMS))
    coupled = resolve_options(scene).dynamics == "coupled"
    if form == "c":
        from kaneflex.export.c_model import c_model
        from kaneflex.export.coupled_in_c import coupled_in_c

        return coupled_in_c(scene, progress) if coupled else dict(c_model(scene, progress).texts)
    if form == "standalone":
        from kaneflex.export.standalone import standalone

        return standalone(scene, progress)
    progress("importing SymPy")
    from kaneflex.multibody.model.module_loading import generate_text, laws_text, pruned_text

    if form == "pruned":
        return pruned_text(scene, progress)
    return (laws_text if coupled else generate_text)(scene, progress)
