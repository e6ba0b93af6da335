"""Functions that are compiled only where a mechanism has contacts or holds, and what stands in for them elsewhere."""

from __future__ import annotations

import inspect

from numba import typeof
from numba.extending import intrinsic

from kaneflex.multibody.tables import CONTACT_MECHANISM, HOLD_MECHANISM


def of_contacts(otherwise):
    """A decorator, above numba's: the function is compiled where a mechanism has contacts, and is this number else.

    So whoever has none, as most have, needn't wait for a third more to be compiled.
    """
    return _where(otherwise, (CONTACT_MECHANISM, HOLD_MECHANISM))


def of_holds(otherwise):
    """The same where a mechanism has holds."""
    return _where(otherwise, (HOLD_MECHANISM,))


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
        made.where = function, mechanisms, otherwise  # for whoever prints it in C
        return made

    return of
