"""Module of the kernels of a body that moves freely and deforms, printed as loops over its shapes.

Kane's equations of a body with one shape of each kind (:mod:`kaneflex.derive.body_equations`) say what is summed over
the shapes (:mod:`kaneflex.derive.loops`). Numbers of shapes enter when the kernels are compiled: one text serves every
body of every scene. Nothing is printed that is not proved (:mod:`kaneflex.derive.body_proof`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from textwrap import indent

from kaneflex.derive import module_text
from kaneflex.derive.body_kernels import kernels
from kaneflex.derive.body_proof import prove
from kaneflex.support.contract import BODY_BLOCK, POINT_BLOCK, Slot


@cache
def body_text() -> str:
    """Text of ``generated/body.py``.

    Raises
    ------
    NotKane
        If a kernel differs from the derived equations.
    """
    text = kernels_text()
    prove(text)
    title = "Kernels of one body that moves freely in the plane and deforms"
    said = "# What the numbers in p are is said in kaneflex.support.contract, BODY_BLOCK and POINT_BLOCK."
    before = ("from functools import cache", "from types import SimpleNamespace")
    return module_text.module(title, [_ABOUT.strip(), "", module_text.UNCHECKED], [said], [text], before=before)


def kernels_text() -> str:
    """Text of the function ``kernels``, which has not been proved."""
    return KERNELS.format(
        body=indent("\n".join(_offsets(BODY_BLOCK, "size")), " " * 4),
        point=indent("\n".join(_offsets(POINT_BLOCK, "point")), " " * 4),
        kernels=indent("\n".join(kernels()), " " * 4),
    )


def _offsets(block: Sequence[Slot], size: str) -> list[str]:
    """Offsets of the slots of a block, in sequence, and the size of the whole."""
    counts = {"s": "axial", "w": "transverse", "a": "shapes"}
    lines, start = [], "0"
    for slot in block:
        lines.append(f"{slot.name} = {start}  # {' + '.join(slot.of)}{''.join(f' - {name}' for name in slot.less)}")
        start = f"{slot.name} + {' * '.join(counts[axis] for axis in slot.axes) or 1}"
    return [*lines, f"{size} = {start}"]


_ABOUT = """
A slice of the body stands at r + R(phi) (X + s_j b_j - 1/2 H_jk a_j a_k, Y + w_j a_j) and turns by phi + psi_k a_k.
Its modal coordinates, axial b before transverse a, begin at q[i], their rates at v[i], their accelerations at a[i];
c and s are the cosine and the sine of phi, omega its rate. The numbers of a body begin at p[o], or those of a point of
it. Sums over the shapes l are called after what they weigh: sw_a1 is sum_l m_sw[j, l] v[i + axial + l].
"""

KERNELS = '''@cache
def kernels(axial, transverse):
    """Kernels of a body with so many axial and transverse shapes, compiled for them when they are first called.

    Beside them ``size`` and ``point``: the lengths of the blocks of a body and of a point.
    """
    shapes = axial + transverse

    # Where the numbers of a body stand in its block ...
{body}

    # ... and those of a point in its own.
{point}
{kernels}
    return SimpleNamespace(
        deform=deform, push=push, jacobian=jacobian, inverse=inverse, inertia=inertia, energy=energy,
        size=size, point=point,
    )
'''
