"""Contacts in words, with the restitution that their laws really return."""

from __future__ import annotations

import math

from kaneflex.scene.contacts import ClearanceContact, Contact
from kaneflex.scene.friction import Friction

_SIDES = {
    "point-line": "{1} before the line through {0}", "circle-circle": "circles about {1} and {0}",
    "circle-in-circle": "circle about {1} in that about {0}", "angle": "flank of {0} that turns {1} {way}",
}  # fmt: skip


def contact_line(contact: Contact) -> str:
    """Line of a contact: its two sides, its stiffness, and the share that returns of an approach."""
    where = _SIDES[contact.kind].format(*contact.sides, way="on" if contact.direction[0] > 0 else "back")
    if contact.corner:
        where = f"corner of {contact.sides[1].body} at a face of {contact.sides[0]}"
    stiffness, exponent = contact.pushing
    if isinstance(contact, ClearanceContact) and contact.kind == "angle":
        room = contact.direction[0] * contact.clearance.middle - contact.reach
        law = f"{stiffness:.4g} N m/rad" + ("" if exponent == 1 else f"^{exponent:.4g}")
        law = "rigid" if contact.law == "newton" else law
        return f"{where}, play {math.degrees(room):.6g} deg, {law}, {restitution_line(contact)}"
    if contact.joint is not None:
        room = contact.reach if contact.kind == "circle-in-circle" else -contact.reach - contact.number("height") / 2
        where += f", clearance {1e3 * room:.6g} mm"
    if contact.law == "newton":
        return f"{where}, rigid, {restitution_line(contact)}"
    unit = "N/m" if exponent == 1 else f"N/m^{exponent:.4g}"
    return f"{where}, {stiffness:.4g} {unit}, {restitution_line(contact)}"


def restitution_line(contact: Contact) -> str:
    """A law beside the restitution that it returns, nothing else acting: which few return as they are asked for."""
    law, asked = contact.law, contact.contact.restitution
    if law == "kelvin-voigt":
        unit = "N m s/rad" if contact.kind == "angle" else "N s/m"
        return f"{law} of {contact.contact.damping:.6g} {unit}, whose restitution follows from the masses"
    if law == "newton":
        return f"newton returns {asked:.3g} at once"
    if asked is None:
        return f"{law} returns 1"
    from kaneflex.mechanism.contacts import hysteresis, returned

    found = returned(hysteresis(law, asked))
    return f"{law} returns {found:.3g}" + ("" if law == "exact" else f", asked for {asked:.3g}")


def friction_line(friction: Friction) -> str:
    """A friction's law with its numbers."""
    keys = ("mu", "mu_static", "preload", "viscous", "bristle_stiffness", "bristle_damping")
    found = {key: getattr(friction, key) for key in keys}
    return f"{friction.law}, " + ", ".join(f"{key} {value:.4g}" for key, value in found.items() if value)
