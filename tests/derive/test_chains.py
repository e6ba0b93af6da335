"""Nothing grows faster than the equations: operations of the motion of chains of elastic links."""

import ast

import pytest
from chains import chain
from runs import tables

from kaneflex.derive.generate import generate
from kaneflex.scene import Scene


def operations(scene: Scene) -> int:
    """Operations of the kernel ``motion`` as it is emitted."""
    return tables(ast.parse(generate(scene)))["OPERATIONS"]["motion"][1]


@pytest.mark.parametrize(("closed", "counts"), [(False, (2, 3, 4)), (True, (4, 5, 6))])
def test_each_link_adds_the_same_number_of_operations(closed, counts, tmp_path):
    """A pose is its predecessor's and one turn more, a reaction what its neighbours leave: shared, each link costs
    alike.

    Written out, the terms of the last link hold the turns of all others and multiply with each of them.
    """
    found = [operations(chain(count, closed, tmp_path)) for count in counts]
    a_link = [(b - a) / (n - m) for a, b, m, n in zip(found, found[1:], counts, counts[1:], strict=False)]
    assert a_link[1] == pytest.approx(a_link[0], rel=0.02)
    assert 30 < a_link[0] < 100
