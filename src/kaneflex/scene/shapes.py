"""Shapes of cross-sections: areas, second moments, torsion and shear."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from kaneflex.scene.quantities import PositiveLength, components, list_of
from kaneflex.scene.sections import SectionNumbers
from kaneflex.scene.table import SceneTable, first_given, the_one_given
from kaneflex.support.errors import Fault
from kaneflex.support.units import LENGTH


def _dimensions(*names: str) -> Any:
    """Field of several positive lengths, written as a list."""
    wanted = f"[{', '.join(names)}]"

    count = len(names)

    def convert(value: object) -> tuple[float, ...]:
        lengths = components(value, LENGTH, f"not the {count} lengths of this shape", f"Write {wanted}", (count,))
        if min(lengths) <= 0:
            raise Fault("a length must be above zero", f"Write {wanted}")
        return lengths

    schema = list_of({"type": ["number", "string"]}, count, count, description=f"{wanted} in m")
    return Annotated[tuple[float, ...], BeforeValidator(convert), WithJsonSchema(schema)]


def torsion_constant(height: float, width: float) -> float:
    """Torsion constant J [m^4] of a rectangle, Saint-Venant's series (Timoshenko & Goodier, Theory of Elasticity, 109).

    J = a b^3/3 (1 - 192 b/(pi^5 a) sum tanh(n pi a/2b)/n^5) over odd n with a >= b. Only tanh - 1 is summed, since
    sum 1/n^5 = 31/32 zeta(5).
    """
    a, b = max(height, width), min(height, width)
    lacks = sum(2 / (math.exp(min(n * math.pi * a / b, 700.0)) + 1) / n**5 for n in range(1, 16, 2))
    return a * b**3 / 3 * (1 - 192 * b / (math.pi**5 * a) * (_ODD_FIFTHS - lacks))


_ODD_FIFTHS = 31 / 32 * 1.0369277551433699
"""Sum of 1/n^5 over odd n."""


def _rectangle(nu: float, height: float, width: float) -> SectionNumbers:
    """Rectangle; shear by Cowper (1966), J. Applied Mechanics 33, 335-340; 5/6 for nu = 0."""
    k = 10 * (1 + nu) / (12 + 11 * nu)
    J = torsion_constant(height, width)
    return SectionNumbers(height * width, height * width**3 / 12, width * height**3 / 12, J, k, k)


def _round(A: float, I: float, k: float) -> SectionNumbers:
    return SectionNumbers(A, I, I, 2 * I, k, k)


def _circle(nu: float, diameter: float) -> SectionNumbers:
    """Circle; shear by Cowper (1966)."""
    return _round(math.pi * diameter**2 / 4, math.pi * diameter**4 / 64, 6 * (1 + nu) / (7 + 6 * nu))


def _tube(nu: float, diameter: float, wall: float) -> SectionNumbers:
    """Tube; shear by Cowper (1966), m is the ratio of the inner to the outer radius."""
    inner = diameter - 2 * wall
    m = inner / diameter
    square = (1 + m**2) ** 2
    kappa = 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * m**2)
    return _round(math.pi * (diameter**2 - inner**2) / 4, math.pi * (diameter**4 - inner**4) / 64, kappa)


def _i_section(nu: float, height: float, width: float, flange: float, web: float) -> SectionNumbers:
    """I section; A, I_y and I_z are exact, torsion and shear are those of thin walls.

    Shear along the height by Cowper (1966), with the height between the middles of the flanges; along the width only
    the two flanges carry it, each as a rectangle. J is the sum of the strips' length thickness^3/3 (Timoshenko &
    Goodier, Theory of Elasticity, 110), with the web's length between the middles of the flanges.
    """
    clear = height - 2 * flange
    middle = height - flange
    m, n = 2 * width * flange / (middle * web), width / middle
    denominator = 12 + 72 * m + 150 * m**2 + 90 * m**3 + nu * (11 + 66 * m + 135 * m**2 + 90 * m**3)
    denominator += 30 * n**2 * (m + m**2) + 5 * nu * n**2 * (8 * m + 9 * m**2)
    kappa = 10 * (1 + nu) * (1 + 3 * m) ** 2 / denominator
    area = 2 * width * flange + web * clear
    return SectionNumbers(
        A=area,
        I_y=(2 * flange * width**3 + clear * web**3) / 12,
        I_z=(width * height**3 - (width - web) * clear**3) / 12,
        J=(2 * width * flange**3 + middle * web**3) / 3,
        k_y=kappa,
        k_z=10 * (1 + nu) / (12 + 11 * nu) * 2 * width * flange / area,
    )


_SHAPES: dict[str, Callable[..., SectionNumbers]] = {
    "rectangle": _rectangle,
    "circle": _circle,
    "tube": _tube,
    "I": _i_section,
}


class Shape(SceneTable):
    """Section by its shape (exactly one of the four), bent in the plane of its height."""

    rectangle: _dimensions("height", "width") | None = None
    circle: PositiveLength | None = Field(default=None, description="diameter")
    tube: _dimensions("outer diameter", "wall") | None = None
    I: _dimensions("height", "width", "flange", "web") | None = None

    @model_validator(mode="after")
    def _possible(self) -> Shape:
        the_one_given(self, tuple(_SHAPES))
        if self.tube is not None and 2 * self.tube[1] >= self.tube[0]:
            raise Fault("the wall fills the tube", "Give less than half the diameter, or a circle", below="tube")
        if self.I is not None:
            height, width, flange, web = self.I
            if 2 * flange >= height or web > width:
                raise Fault("flanges or web don't fit", "Write [height, width, flange, web]", below="I")
        return self

    @property
    def kind(self) -> str:
        return first_given(self, tuple(_SHAPES))

    @property
    def dimensions(self) -> tuple[float, ...]:
        """Lengths of the shape in m, in the order of the file."""
        found = getattr(self, self.kind)
        return found if isinstance(found, tuple) else (found,)

    def numbers_of(self, dimensions: tuple[float, ...], nu: float | None) -> SectionNumbers:
        """Numbers of a section of this kind of shape at Poisson's ratio `nu`; the height is along y."""
        numbers = _SHAPES[self.kind](nu if nu is not None else 0.0, *dimensions)
        return numbers if nu is not None else numbers._replace(k_y=None, k_z=None)
