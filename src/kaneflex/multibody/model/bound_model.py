"""A scene with numbers bound to its kernels, ready for integration and evaluation."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, cast

import numpy as np

from kaneflex.fem.assembly import ElasticEquations, spin_or_euler
from kaneflex.fem.coordinate_map import Frame, Interfaces, Placed
from kaneflex.fem.links import Link, Part
from kaneflex.fem.modes import rayleigh_coefficients
from kaneflex.integrate.system import AffineSystem
from kaneflex.mechanism.affine import Affine, Monomial, Products, as_array, numbered_entries
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion, not_integrated
from kaneflex.scene import Scene
from kaneflex.scene.option_check import refuse_in_space
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError, counted
from kaneflex.support.escaping import visible

if TYPE_CHECKING:
    from kaneflex.mechanism.energy import Energy
    from kaneflex.mechanism.kernels import Kernels
    from kaneflex.multibody.model.system import System
    from kaneflex.multibody.time.spatial_motion import CoupledKinematics, SpatialKinematics


REACHED = {"rad": 1e-3, "m": 1e-5}
"""Largest distance of the first drive, by its unit, from the requested coordinate."""
_FROM_EQUATIONS = ("kept", "kept_parts", "monomials", "_products", "system")
"""Cached attributes that follow from the equations and options alone."""
NO_EQUATIONS = ElasticEquations.zero(())
JOINT_FORCES = ("force_x", "force_y", "normal", "moment", "drive")
"""Scalars JOINT.NAME of the motion: joint forces and moment on its second body, and its drive's force or torque."""


@dataclass(frozen=True, eq=False)
class Model:
    """A scene bound to its generated module, ready to be simulated. Made by :func:`kaneflex.load`.

    Without linear elastic equations its reference configuration is that of the first instant.

    Attributes
    ----------
    scene, options
        Scene without entries that the options do not use, and all options resolved.
    motion : RigidKinematics
        Rigid motion; before a run that integrates free joints, at its start only.
    links : mapping of str to Link
        Elastic bodies with their meshes.
    parts : mapping of str to Part
        The links as assembled, reduced if requested.
    bases : mapping of str to ndarray
        Craig-Bampton basis of each reduced link.
    interfaces, frame
        Connections of the parts.
    equations : ElasticEquations
        Assembled and constrained, in the coordinates ``coordinates``.
    reduced : ElasticEquations
        The integrated equations: ``equations``, or their form in modes of the mechanism; frozen under preset ``paper``.
    modal_basis : ndarray or None
        Modes of the whole mechanism in columns, if the motion is computed in them.
    reference_time : float
        Instant [s] at which the first drive is at ``options.mode_angle``; 0 if it never is.
    coupled : System or None
        The coupled equations, under preset ``coupled``.
    energy : Energy or None
        Energies of a motion that was integrated before the elastic equations: of the rigid mechanism with free joints.
        None before the run.
    seconds : mapping
        Wall time of the stages of loading.
    given : Scene or None
        The scene as it was loaded, with all entries.
    placed : tuple of Placed
        Bodies, lumped masses, loads and springs at their sites, all but the links.
    sprung : mapping of str to Placed
        Springs.
    """

    scene: Scene
    options: Options
    motion: RigidKinematics
    links: Mapping[str, Link] = field(default_factory=dict)
    parts: Mapping[str, Part] = field(default_factory=dict)
    bases: Mapping[str, np.ndarray] = field(default_factory=dict)
    interfaces: Interfaces | None = None
    frame: Frame | None = None
    equations: ElasticEquations = NO_EQUATIONS
    reduced: ElasticEquations = NO_EQUATIONS
    modal_basis: np.ndarray | None = None
    reference_time: float = 0.0
    coupled: System | None = None
    energy: Energy | None = None
    warnings: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    given: Scene | None = None
    placed: tuple[Placed, ...] = ()
    sprung: Mapping[str, Placed] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"Model({self.in_short})"

    def _repr_html_(self) -> str:
        """Table of the model's main data for notebooks."""
        from kaneflex.support.html import shown

        links = ", ".join(f"{name} ({len(link.part.coordinates)})" for name, link in self.links.items())
        rows = [
            ("preset", self.options.preset), ("integrator", self.options.integrator), ("links (coordinates)", links),
            ("degrees of freedom", str(self.degrees_of_freedom)), ("solved for", str(self.solved_for)),
            ("duration [s]", self.options.duration), ("steps", str(self.options.steps)),
        ]  # fmt: skip
        return shown(f"{self.scene.name}: {self.scene.description}", ("", ""), rows, self.warnings)

    @property
    def in_short(self) -> str:
        """Name, preset and degrees of freedom."""
        freedom = counted(self.degrees_of_freedom, "degree of freedom")
        return f"{visible(self.scene.name)}, {self.options.preset}, {freedom}"

    @property
    def degrees_of_freedom(self) -> int:
        """Number of elastic degrees of freedom before any reduction, or of shapes for bodies with modal data.

        In a coupled model without linear elastic equations: number of free coordinates and of all shapes.
        """
        if self.without_linear or self._solved_in_space:
            return self.solved_for
        nodal = self.equations.size + sum(len(basis) - basis.shape[1] for basis in self.bases.values())
        return nodal + len(self.shapes_given)

    @property
    def in_space(self) -> SpatialKinematics | None:
        """The motion of a mechanism in space; None in the plane."""
        return cast("SpatialKinematics", self.motion) if self.scene.is_spatial else None

    @property
    def coupled_in_space(self) -> CoupledKinematics | None:
        """The motion of a mechanism in space under preset ``coupled``, which has its shapes; None for others."""
        return cast("CoupledKinematics", self.in_space) if self.options.dynamics == "coupled" else None

    @property
    def coupled_system(self) -> System:
        """System of the equations of motion: of preset ``coupled``, in space of all presets."""
        return self.coupled or cast("SpatialKinematics", self.motion).module.system

    @property
    def meshes(self) -> Mapping[str, Link]:
        """Elastic links with their finite elements; for a coupled mechanism in space those of its shapes."""
        if self.coupled_in_space is None:
            return self.links
        return self.coupled_system.links

    @property
    def awaits_run(self) -> bool:
        """True if a run first integrates the motion: with free joints, or of a coupled mechanism in space."""
        coupled = self.coupled_in_space
        return self.motion.is_start or (coupled is not None and not coupled.curve.whole)

    @property
    def without_linear(self) -> bool:
        """True if a coupled model has no linear elastic equations, see
        :func:`kaneflex.solve.engine_loading.has_elastic_stage`."""
        return self.coupled is not None and not self.equations.size

    @property
    def solved_for(self) -> int:
        """Number of coordinates that are integrated."""
        if self._solved_in_space:
            return len(cast("SpatialKinematics", self.in_space).curve.start.choice.independent)
        if self.coupled is not None:
            return len(mechanism_of(self.scene).free) + int(self.coupled.engine.shapes.sum())
        return self.reduced.size

    @property
    def _solved_in_space(self) -> bool:
        """True if the equations of motion of a mechanism in space have all coordinates of the run."""
        return self.in_space is not None and self.options.dynamics in ("rigid", "coupled")

    @property
    def shapes_given(self) -> tuple[str, ...]:
        """Coordinates of the shapes of bodies with modal data, which preset coupled does not reduce."""
        if self.coupled is None:
            return ()
        from kaneflex.mechanism.floating_frames import shapes_given

        return shapes_given(mechanism_of(self.scene).deforming)

    @property
    def reference_coordinates(self) -> dict[str, float]:
        """Coordinate of each drive at ``reference_time`` [rad or m]; the first as requested if it is reached."""
        rigid, asked = self.motion.at(self.reference_time), self.options.mode_angle
        found = {name: float(rigid[f"{name}.angle"][0]) for name in self.scene.drives}
        for name in list(found)[:1]:
            slides = self.scene.slides(name)
            away = found[name] - asked if slides else math.remainder(found[name] - asked, 2.0 * math.pi)
            if abs(away) < REACHED["m" if slides else "rad"]:
                found[name] = asked
        return found

    @property
    def reference_position(self) -> str:
        """Text of :attr:`reference_coordinates`, like "main = 90 deg"; empty without a drive."""
        return mechanism_of(self.scene).written(self.reference_coordinates)

    @property
    def module(self) -> ModuleType:
        """The generated module whose kernels are used."""
        return self.motion.module

    @property
    def balances(self) -> bool:
        """True if the equations balance at every instant, so that reactions follow from their residual.

        Those of the paper's frozen model don't: its matrices are those of one crank angle, its loads those of all.
        """
        return self.options.dynamics in ("dynamic", "quasistatic", "coupled")

    @cached_property
    def rayleigh(self) -> tuple[float, float]:
        """alpha [1/s] and beta [s] of the kept damping alpha M + beta K_s of links, bodies and lumped masses."""
        damping = self.scene.damping
        if damping is None or damping.kind != "rayleigh" or not self.options.damping:
            return 0.0, 0.0
        return rayleigh_coefficients(damping.rayleigh.ratio, *damping.rayleigh.at)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the rows of M, C, K and F: u, v [m] and theta [rad] of nodes, x, y [m] of joints, slides [m]."""
        return self.equations.coordinates

    @property
    def step(self) -> float:
        """Time step [s]."""
        return self.options.duration / self.options.steps

    def M(self, t: float) -> np.ndarray:
        """Mass matrix at time t [s], shape (n, n)."""
        return self._at("M", t)

    def K_s(self, t: float) -> np.ndarray:
        """Elastic stiffness at time t [s], shape (n, n)."""
        return self._at("K_s", t)

    def K_d(self, t: float) -> np.ndarray:
        """Spin and Euler stiffness at time t [s], with the terms of rotating joint axes if included, shape (n, n)."""
        return self._at("K_d", t)

    def K_c(self, t: float) -> np.ndarray:
        """Stiffness due to damping in rotating links at time t [s], shape (n, n)."""
        return self._at("K_c", t)

    def K_g(self, t: float) -> np.ndarray:
        """Geometric stiffness by the axial forces at time t [s], shape (n, n)."""
        return self._at("K_g", t)

    def C(self, t: float) -> np.ndarray:
        """Damping and gyroscopic matrix C_s + C_d at time t [s], shape (n, n)."""
        return self._at("C", t)

    def F(self, t: float) -> np.ndarray:
        """Load at time t [s], shape (n,)."""
        return self._at("F", t)

    def _at(self, name: str, t: float) -> np.ndarray:
        found = as_array(self.motion.at(float(t)).first(sums(self.equations)[name]))
        return found[:, 0] if name == "F" else found

    @cached_property
    def kernels(self) -> Kernels:
        """Compiled kernels of the integrated equations, with the term groups that the options keep, and argument p.

        Raises SceneError under preset ``coupled``, whose matrices depend on the coordinates, in space, and with free
        joints before a run.
        """
        from kaneflex.mechanism.kernels import Kernels, bind, place_of_points, scalars_of

        refuse_in_space(self.scene, "kernels", "compiled kernels exist for")
        if self.coupled is not None:
            raise SceneError(
                "solve.preset", "coupled", "its M, K and F depend on the coordinates, not on time alone",
                "Use model.coupled.project(t, q, u, choice), or another preset",
            )  # fmt: skip
        if self.motion.is_start:
            raise not_integrated(self.options.duration)
        points = {
            f"{name}.{point}": (name, place)
            for name, body in self.scene.bodies.items() for point, place in body.points_all.items()
        }  # fmt: skip
        exerted = re.compile(rf"({'|'.join(map(re.escape, self.scene.joints))})\.({'|'.join(JOINT_FORCES)})")
        forces = {name: unit for name, unit, *_ in self.module.SCALARS if exerted.fullmatch(name)}
        found = self.kept_parts | {"positions": place_of_points(points), "inverse_dynamics": scalars_of(tuple(forces))}
        return Kernels(bind(self.motion, found), self.reduced.coordinates, tuple(points), forces)

    def sharing(self, like: Model) -> Model:
        """This model with the cached results of another one that has the same equations and options."""
        if self.reduced is like.reduced:
            vars(self).update({name: vars(like)[name] for name in _FROM_EQUATIONS if name in vars(like)})
        return self

    @cached_property
    def kept(self) -> dict[str, Affine]:
        """M, C, K, F of the integrated equations: the sums of :attr:`kept_parts`."""
        return {name: self.kept_parts[name] for name in "MCKF"}

    @cached_property
    def kept_parts(self) -> dict[str, Affine]:
        """:func:`sums` of the integrated equations, with the term groups that the options keep.

        Terms that are zero by structure are left out: those of a link whose motion lacks a scalar.
        """
        return keep_terms(self.reduced.fixed(self.module.CONSTANTS), self.options)

    @cached_property
    def monomials(self) -> tuple[Monomial, ...]:
        """The products of motion scalars that the kept equations are made of."""
        return self.motion.ordered(set().union(*(affine.terms for affine in self.kept.values())))

    def scalars(self, times: np.ndarray) -> np.ndarray:
        """The table that integrators read: ``monomials`` at ``times`` [s], shape (n_times, n_monomials)."""
        return self._products.at(self.motion.table(times))

    def scalars_of(self, motion: RigidMotion) -> np.ndarray:
        """The same at the instants of a rigid motion."""
        return self._products.at(motion.values)

    @cached_property
    def _products(self) -> Products:
        return Products.of(self.monomials, self.motion.column)

    @cached_property
    def system(self) -> AffineSystem:
        """The kept equations as the integrators read them."""
        entries = (numbered_entries(self.kept[name], self.monomials) for name in "MCKF")
        return AffineSystem.of(self.reduced.size, len(self.monomials), *entries)


def keep_terms(equations: ElasticEquations, options: Options) -> dict[str, Affine]:
    """:func:`sums` of some equations with the complete term groups that the options keep."""
    zero = Affine.zero(equations.size, equations.size)
    spin = equations.K_d.only(lambda monomial: options.euler if spin_or_euler(monomial) == "euler" else options.spin)
    return sums(
        replace(
            equations, K_d=spin, C_s=equations.C_s if options.damping else zero,
            K_c=equations.K_c if options.damping else zero, C_d=equations.C_d if options.gyroscopic else zero,
            K_g=equations.K_g if options.geometric else zero,
        )
    )  # fmt: skip


def sums(equations: ElasticEquations) -> dict[str, Affine]:
    """M, C = C_s + C_d, K = K_s + K_d + K_c + K_g and F of some equations, and the parts of K."""
    parts = {name: getattr(equations, name) for name in ("K_s", "K_d", "K_c", "K_g")}
    whole = sum(parts.values(), Affine.zero(equations.size, equations.size))
    return {"M": equations.M, "C": equations.C_s + equations.C_d, "K": whole, "F": equations.F, **parts}
