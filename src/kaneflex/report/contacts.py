"""Contacts in words, with the restitution that their laws really return."""

from __future__ import annotations

from kaneflex.mechanism.contacts import hysteresis, returned
from kaneflex.scene.contacts import Contact

_SIDES = {
    "point-line": "{1} before the line through {0}", "circle-circle": "circles about {1} and {0}",
    "circle-in-circle": "circle about {1} in that about {0}",
}  # fmt: skip


def contact_line(contact: Contact) -> str:
    """What touches what, how stiff that is, and what comes back of an approach."""
    where = _SIDES[contact.kind].format(*contact.sides)
    if contact.corner:
        where = f"corner of {contact.sides[1].body} at a face of {contact.sides[0]}"
    if contact.joint is not None:
        room = contact.reach if contact.kind == "circle-in-circle" else -contact.reach - contact.number("height") / 2
        where += f", clearance {1e3 * room:.6g} mm"
    stiffness, exponent = contact.pushing
    unit = "N/m" if exponent == 1 else f"N/m^{exponent:.4g}"
    return f"{where}, {stiffness:.4g} {unit}, {restitution_line(contact)}"


def restitution_line(contact: Contact) -> str:
    """A law beside the restitution that it returns, nothing else acting: which few return as they are asked for."""
    law, asked = contact.law, contact.contact.restitution
    if law == "kelvin-voigt":
        return f"{law} of {contact.contact.damping:.6g} N s/m, whose restitution follows from the masses"
    if asked is None:
        return f"{law} returns 1"
    found = returned(hysteresis(law, asked))
    return f"{law} returns {found:.3g}" + ("" if law == "exact" else f", asked for {asked:.3g}")
