"""Functions compiled only for mechanisms with contacts, holds or stiffness, and their stand-ins elsewhere."""

from __future__ import annotations

import inspect

from numba import typeof
from numba.extending import intrinsic

from kaneflex.multibody.compile.mechanisms import (
    CONTACT_MECHANISM,
    CONTACT_SPACE,
    HOLD_MECHANISM,
    HOLD_SPACE,
    IMPACT_MECHANISM,
    MECHANISM,
    SPACE,
    SWITCHED_SPACE,
)

_WITH_HOLDS = HOLD_MECHANISM, HOLD_SPACE
_WITH_IMPACTS = IMPACT_MECHANISM, HOLD_MECHANISM
_WITH_CONTACTS = CONTACT_MECHANISM, CONTACT_SPACE, HOLD_SPACE, *_WITH_IMPACTS


def of_contacts(otherwise):
    """Decorator, above numba's: the function is compiled for mechanisms with contacts, and returns this constant
    elsewhere.

    Most mechanisms have no contacts and save a third of the compilation.
    """
    return _where(otherwise, _WITH_CONTACTS)


def of_changes(otherwise):
    """As :func:`of_contacts`, for mechanisms with contacts or discontinuous loads, in the plane and in space."""
    return _where(otherwise, (*_WITH_CONTACTS, SWITCHED_SPACE))


def of_impacts(otherwise):
    """As :func:`of_contacts`, for planar mechanisms with holds, or with contacts by Newton's law."""
    return _where(otherwise, _WITH_IMPACTS)


def of_holds(otherwise):
    """As :func:`of_contacts`, for mechanisms with holds."""
    return _where(otherwise, _WITH_HOLDS)


def of_stiffness(otherwise):
    """As :func:`of_contacts`, for mechanisms with elastic bodies, or springs and loads that need derivatives."""
    return _where(otherwise, (MECHANISM, *_WITH_CONTACTS, SPACE, SWITCHED_SPACE))


def _where(otherwise, mechanisms):

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
