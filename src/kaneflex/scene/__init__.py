"""Scenes: reading and checking of a user's input."""

from kaneflex.scene.read import json_schema, read_scene, scene_of, shipped_scenes, with_settings
from kaneflex.scene.scene import Scene

__all__ = ["Scene", "json_schema", "read_scene", "scene_of", "shipped_scenes", "with_settings"]
