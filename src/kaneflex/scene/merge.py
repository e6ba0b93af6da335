"""`like`: starting from another scene, or from another body, and changing or removing some of it."""

from __future__ import annotations

from typing import Any

from kaneflex.support.errors import SceneError, nearest

REMOVED = "none"
_OWN_WORD = ("reduction",)  # its "none" is a word of its own


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`base` with `changes` put over it, table by table; the order is that of `base`, what is new comes last.

    "none" removes what the base has.
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
    """Every body with the one that its `like` names merged under it; `like` is gone afterwards."""
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
        raise SceneError(f"bodies.{name}.like", model, "bodies start from each other", "Break the circle")
    rest = {key: value for key, value in body.items() if key != "like"}
    base = _reused(model, bodies, (*users, name))
    if not isinstance(base, dict):
        raise SceneError(f"bodies.{name}.like", model, "that body is not a table", "Write a table, like {key = value}")
    return merged(base, rest)
