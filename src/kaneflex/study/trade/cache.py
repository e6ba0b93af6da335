"""Choices kept in the user's cache: what was chosen once for the same scene is not looked for again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from kaneflex.scene import Scene
from kaneflex.solve.loading import Progress
from kaneflex.study.plan import digest, file_places
from kaneflex.study.trade.choice import choose
from kaneflex.study.trade.ranking import check_request
from kaneflex.study.trade.record import Choice
from kaneflex.support.module_cache import cache_folder, keep


def remembered_choice(
    scene: Scene, tolerance: float, sensors: Sequence[str] | None = None, progress: Progress = lambda stage: None
) -> Choice:
    """The choice from the cache, else :func:`kaneflex.study.trade.choice.choose`'s, which is then kept.

    A file that can't be read as a choice is replaced.

    Parameters and errors are those of ``choose``; OutputError where the cache can't be written.
    """
    path = choice_file(scene, tolerance, check_request(scene, tolerance, 1.0, sensors))
    try:
        return Choice.model_validate_json(path.read_text(encoding="utf-8")).model_copy(update={"remembered": True})
    except (OSError, UnicodeDecodeError, ValidationError):
        found = choose(scene, tolerance, sensors, progress)
    keep(path, (found.model_dump_json(indent=2) + "\n").encode())
    return found


def choice_file(scene: Scene, tolerance: float, sensors: Sequence[str]) -> Path:
    """Where the choice for a scene is kept: by its structure, and by all else that it depends on.

    That is every entry of the scene, the contents of its tables, the sensors, the tolerance and kaneflex's own sources.
    """
    files = {place: Path(file).read_bytes() for place, file in file_places(scene).items()}
    about = digest(scene, files, sorted(sensors), tolerance)
    return cache_folder() / "choices" / f"{scene.structure_hash()}-{about}.json"
