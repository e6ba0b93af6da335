"""Functions compiled only for mechanisms with contacts, holds or stiffness, and their stand-ins elsewhere."""

from __future__ import annotations

import inspect
from functools import partial

from numba import typeof
from numba.extending import intrinsic

from kaneflex.multibody.compile.mechanisms import HANDED
from kaneflex.multibody.model.layout import Kind


def _where(kinds, otherwise):
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


_WITH_IMPACTS = Kind.IMPACTS, Kind.HOLDS, Kind.IMPACT_SPACE
_WITH_CONTACTS = Kind.CONTACTS, Kind.CONTACT_SPACE, Kind.HOLD_SPACE, *_WITH_IMPACTS
of_contacts = partial(_where, _WITH_CONTACTS)
"""Decorator, above numba's: the function is compiled for mechanisms with contacts, and returns this constant elsewhere.

Most mechanisms have no contacts and save a third of the compilation."""
of_changes = partial(_where, (*_WITH_CONTACTS, Kind.SWITCHED_SPACE))
"""As ``of_contacts``, for mechanisms with contacts or discontinuous loads, in the plane and in space."""
of_impacts = partial(_where, _WITH_IMPACTS)
"""As ``of_contacts``, for mechanisms with contacts by Newton's law, and planar ones with holds."""
of_holds = partial(_where, (Kind.HOLDS, Kind.HOLD_SPACE, Kind.IMPACT_SPACE))
"""As ``of_contacts``, for mechanisms with holds."""
of_modes = partial(_where, (*_WITH_IMPACTS, Kind.HOLD_SPACE))
"""As ``of_contacts``, for mechanisms with holds, or with contacts by Newton's law."""
of_stiffness = partial(_where, (Kind.PLAIN, *_WITH_CONTACTS, Kind.SPACE, Kind.SWITCHED_SPACE))
"""As ``of_contacts``, for mechanisms with elastic bodies, or springs and loads that need derivatives."""
