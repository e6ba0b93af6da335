"""Functions compiled only for mechanisms with contacts, friction or stiffness, and their stand-ins elsewhere."""

from __future__ import annotations

import inspect
from functools import partial

from numba import typeof
from numba.extending import intrinsic

from kaneflex.multibody.compile.mechanisms import HANDED
from kaneflex.multibody.model.layout import Kind


def _compiled_for(kinds, otherwise):
    mechanisms = [HANDED[kind] for kind in kinds]

    def of(function):
        def called(typing, m, *rest):
            if m in mechanisms:
                function.compile((m, *rest))
                found = function.overloads[m, *rest]

                def enter(context, builder, sig, args):
                    context.active_code_library.add_linking_library(found.library)
                    return context.call_internal(builder, found.fndesc, sig, args)

                return found.signature, enter
            kind = typeof(otherwise)

            def stand_in(context, builder, sig, args):
                return context.get_constant_generic(builder, kind, otherwise)

            return kind(m, *rest), stand_in

        first = inspect.Parameter("typing", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        called.__signature__ = inspect.Signature([first, *inspect.signature(function.py_func).parameters.values()])
        made = intrinsic(called)
        made.where = function, mechanisms, otherwise  # for the C printer of this function
        return made

    return of


_WITH_IMPACTS = Kind.IMPACTS, Kind.FRICTIONS, Kind.IMPACT_SPACE
_WITH_CONTACTS = Kind.CONTACTS, Kind.CONTACT_SPACE, Kind.FRICTION_SPACE, *_WITH_IMPACTS
if_contacts = partial(_compiled_for, _WITH_CONTACTS)
"""Decorator, above numba's: the function is compiled for mechanisms with contacts, and returns this constant elsewhere.

Most mechanisms have no contacts and save a third of the compilation."""
if_changes = partial(_compiled_for, (*_WITH_CONTACTS, Kind.SWITCHED_SPACE))
"""As ``if_contacts``, for mechanisms with contacts or discontinuous loads, in the plane and in space."""
if_impacts = partial(_compiled_for, _WITH_IMPACTS)
"""As ``if_contacts``, for mechanisms with contacts by Newton's law, and planar ones with friction."""
if_frictions = partial(_compiled_for, (Kind.FRICTIONS, Kind.FRICTION_SPACE, Kind.IMPACT_SPACE))
"""As ``if_contacts``, for mechanisms with friction."""
if_modes = partial(_compiled_for, (*_WITH_IMPACTS, Kind.FRICTION_SPACE))
"""As ``if_contacts``, for mechanisms with friction, or with contacts by Newton's law."""
if_stiffness = partial(_compiled_for, (Kind.PLAIN, *_WITH_CONTACTS, Kind.SPACE, Kind.SWITCHED_SPACE))
"""As ``if_contacts``, for mechanisms with elastic bodies, or springs and loads that need derivatives."""
