"""Key `like`: start from another scene or body, and change or remove entries."""

from __future__ import annotations

from typing import Any

from kaneflex.support.errors import SceneError, nearest

REMOVED = "none"
_OWN_WORD = ("reduction",)  # here "none" is a value of its own


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Merge `changes` over `base`, table by table, in the order of `base`; new entries come last.

    "none" removes an entry of the base.
    """
    result = dict(base)
    for key, value in changes.items():
        old = base.get(key)
        if value == REMOVED and key in base and key not in _OWN_WORD:
            del result[key]
        elif isinstance(old, dict) and isinstance(value, dict):
            result[key] = merged(old, value)
        else:
            result[key] = value
    return result


def reuse_bodies(raw: dict[str, Any]) -> dict[str, Any]:
    """Bodies merged over those that their `like` names; removes `like`."""
    bodies = raw.get("bodies")
    if not isinstance(bodies, dict):
        return raw
    return raw | {"bodies": {name: _reused(name, bodies, ()) for name in bodies}}


def _reused(name: str, bodies: dict[str, Any], users: tuple[str, ...]) -> Any:
    body = bodies[name]
    if not isinstance(body, dict) or not isinstance(body.get("like"), str):
        return body
    model = body["like"]
    if model not in bodies:
        raise SceneError(f"bodies.{name}.like", model, "no body of that name", nearest(model, bodies))
    if model in (*users, name):
        raise SceneError(f"bodies.{name}.like", model, "bodies refer to each other in a circle", "Remove one reference")
    rest = {key: value for key, value in body.items() if key != "like"}
    base = _reused(model, bodies, (*users, name))
    if not isinstance(base, dict):
        raise SceneError(f"bodies.{name}.like", model, "that body is not a table", "Write a table, like {key = value}")
    return merged(base, rest)
