"""Commands ``trade`` and ``terms``: error and run time of a scene's models, and the effect of each group of terms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from kaneflex.cli.command import (
    Decorator,
    Target,
    combined_options,
    command,
    folder_options,
    json_option,
    names_option,
    print_json,
    write_csv,
    write_into_folder,
    write_json,
)
from kaneflex.cli.scene import UNKNOWN, SceneArguments, gathered, percent, quantity, scene_options, tolerance_of
from kaneflex.support.terminal import echo

if TYPE_CHECKING:
    from kaneflex.study.differences import Difference
    from kaneflex.study.trade.terms import Effect, Terms
    from kaneflex.study.trade.trials import Ranked, Trade

_ALIKE = 1.1
"""Ratio of times up to which a setting is as fast as another."""
Weighed = TypeVar("Weighed", "Trade", "Terms")


def _options(ending: str) -> Decorator:
    """Options of both commands; ``ending`` is the default ending of the folder's name."""
    return combined_options(
        scene_options("preset", "settings"),
        click.option("--tolerance", default="1%", metavar="SHARE", help="Allowed error per sensor.", show_default=True),
        click.option("--budget", default="60s", metavar="TIME", help="Time limit of all runs.", show_default=True),
        names_option("--sensors", help="Sensors to consider. [default: all]"),
        folder_options(ending),
        json_option,
        gathered(asked=SceneArguments, target=Target),
    )


@command()
@_options("trade")
def trade(asked: SceneArguments, target: Target, **limits: Any) -> None:
    """Recommend the cheapest model of SCENE (least computing time) within a tolerance, and rank the others.

    Models differ in preset, elements, modes, steps and tolerance. The reference is the scene's finest
    model, whose own error is estimated first. The folder contains trade.csv, trade.json and a picture.

    \b
      kaneflex trade engine --tolerance 1% --sensors mid_transverse,rod_mid_strain
    """
    from kaneflex.study.trade.trials import trade as ranked

    _weigh("trade", ranked, trade_data, _trade_text, asked, target, limits)


@command()
@_options("terms")
def terms(asked: SceneArguments, target: Target, **limits: Any) -> None:
    """Print the cost of each group of terms of SCENE, its effect on the sensors, and whether the tolerance requires it.

    Each group is left out of preset stiffened, one at a time: spin, gyroscopic, Euler and geometric terms, damping,
    axial deformation, each load, dynamics, two-way coupling and others that the scene has. Each clearance, friction and
    load is left out of preset coupled where only that supports the scene. The folder contains terms.csv, terms.json
    and a picture.

    \b
      kaneflex terms engine --tolerance 0.1%
    """
    from kaneflex.study.trade.terms import terms as left_out

    _weigh("terms", left_out, terms_data, _terms_text, asked, target, limits)


def _trade_text(found: Trade) -> str:
    return f"{choice_line(found)}\n{trade_table(found)}\n{reference_lines(found)}"


def _terms_text(found: Terms) -> str:
    counted = "" if found.operations is None else f"\nThe model with all groups: {found.operations} operations"
    return terms_table(found) + counted


def _weigh(
    ending: str, question: Callable[..., Weighed], data: Callable[[Weighed], Data], text: Callable[[Weighed], str],
    asked: SceneArguments, target: Target, limits: Mapping[str, Any],
) -> None:  # fmt: skip
    """Run one of the two studies; print its result and write it into a folder as CSV and JSON.

    ``limits``: the options tolerance, budget, sensors and as_json.
    """
    from kaneflex.support.units import TIME

    share, seconds = tolerance_of(limits["tolerance"]), quantity("--budget", limits["budget"], TIME)
    scene = asked.read()
    target = target.named(scene, ending)

    def whole(found: Weighed) -> Data:
        own, rows = data(found)
        about = {"scene": found.scene.name, "settings": list(asked.changes), "tolerance": found.tolerance}
        return {**about, **own, "left_out": dict(found.left_out)}, rows

    def write(found: Weighed, folder: Path) -> None:
        own, rows = whole(found)
        write_json(folder / f"{ending}.json", own)
        write_csv(folder / f"{ending}.csv", list(rows[0]) if rows else [], rows)  # all may be left out

    def ask(stage: Callable[[str], None]) -> Weighed:
        return question(scene, share, seconds, limits["sensors"] or None, stage)

    found, as_json = write_into_folder(target, f"{ending}.json", ask, write, ending), limits["as_json"]
    if as_json:
        print_json(whole(found)[0])
    else:
        echo(text(found))
    echo(f"Written to {target.folder}", err=as_json)
    for reason in dict.fromkeys(found.left_out.values()):
        first, *others = [thing for thing, own in found.left_out.items() if own == reason]
        more = f" and {len(others)} others" if len(others) > 1 else "".join(f" and {thing}" for thing in others)
        echo(f"{first}{more} {'are' if others else 'is'} left out: {reason}", err=True)


def trade_table(found: Trade) -> str:
    """Table of all models, the cheapest first; "*" marks the Pareto front."""
    from kaneflex.report.tables import table

    head = ("", "model", "worst sensor", "error", "rms", "set-up", "ns a step", "steps", "total", "spread", "within")
    return table(head, [_row(found, entry) for entry in found.ranked], left=3)


def _row(found: Trade, entry: Ranked) -> tuple[str, ...]:
    cost = entry.cost
    return (
        "*" if entry in found.front else "", entry.name, entry.worst.sensor, percent(entry.error),
        percent(entry.worst.rms_error), f"{1e3 * cost.set_up:.3g} ms", f"{cost.ns_per_step:.0f}", str(cost.steps),
        f"{1e3 * cost.total:.3g} ms", "" if cost.spread is None else f"{100 * cost.spread:.0f} %",
        "yes" if entry.within else "no",
    )  # fmt: skip


def reference_lines(found: Trade) -> str:
    """Reference of the errors, and its own error."""
    reference = found.reference
    lines = ["*: no other model is both faster and more accurate"]
    lines += [f"Reference: {reference.name}; its error estimate is {percent(max(reference.doubts.values()))}"]
    if reference.note:
        lines.append(f"{UNKNOWN}: {reference.note}")
    return "\n".join(lines)


def choice_line(found: Trade) -> str:
    """Cheapest model within the tolerance, comparison of the scene's own with it, and the cost of more accuracy."""
    chosen, share = found.chosen, percent(found.tolerance)
    if chosen is None:
        return f"None of the models that were run is within {share}"
    settings = " ".join(f"--set {setting}" for setting in found.settings_of(chosen))
    lines = [f"Cheapest within {share}: {chosen.name}", f"  {settings}"]
    own = found.of_scene
    if own is not None:
        times = own.cost.total / chosen.cost.total
        slower = f"is {times:.2g} times slower than needed for {share}" if times > _ALIKE else f"is fast for {share}"
        lines.append(f"Your setting {slower if own.within else f'misses {share}: its error is {percent(own.error)}'}")
    better = next((entry for entry in found.front if entry.error < 0.5 * chosen.error), None)
    if better is not None:
        more = 1e3 * (better.cost.total - chosen.cost.total)
        lines.append(f"{percent(chosen.error - better.error)} more accuracy costs {more:.2g} ms: {better.name}")
    return "\n".join(lines)


def terms_table(found: Terms) -> str:
    """Table of all groups, those with the largest effect first."""
    from kaneflex.report.tables import table

    head = ("group", "", "needed", "most in", "change", "rms", "operations")
    return table(head, [_effect_row(effect) for effect in found.effects], left=4)


def _effect_row(effect: Effect) -> tuple[str, ...]:
    changes = ("does not run without" if effect.needed else "shows only rounding", "", "")
    if effect.differences:
        changes = (effect.worst.sensor, percent(effect.worst.error), percent(effect.worst.rms_error))
    own = (effect.group.name, effect.group.meaning, "yes" if effect.needed else "no", *changes)
    return (*own, "" if effect.operations is None else f"{effect.operations:+d}")


Row = dict[str, object]
Data = tuple[dict[str, object], list[Row]]
"""Data of a study as a whole, and the rows of its table."""


def trade_data(found: Trade) -> Data:
    """Content of ``trade.json`` and ``trade.csv``: times in s, errors as shares of the reference's peaks."""
    reference, rows, models = found.reference, list[Row](), list[Row]()
    for entry in found.ranked:
        cost, error = asdict(entry.cost), entry.worst
        own = {"rms": error.rms_error, "good_enough": entry.within, "on_front": entry in found.front}
        own |= {name: cost[name.removesuffix("_s")] for name in _COSTS}
        rows.append({"model": entry.name, "error": entry.error, "worst_sensor": error.sensor, **own})
        more = {"settings": list(found.settings_of(entry)), "cost": cost, "sensors": _shares(entry.differences)}
        models.append(rows[-1] | more)
    return {
        "reference": {
            "name": reference.name,
            "settings": list(reference.model.settings),
            "doubt": dict(reference.doubts),
            "note": reference.note,
        },
        "chosen": None if found.chosen is None else found.chosen.name,
        "front": [entry.name for entry in found.front],
        "own": None if found.of_scene is None else found.of_scene.name,
        "models": models,
    }, rows


_COSTS = ("set_up_s", "ns_per_step", "steps", "read_s", "total_s", "spread", "repeats", "first_s")


def terms_data(found: Terms) -> Data:
    """Content of ``terms.json`` and ``terms.csv``: times in s or ns, changes as shares of each sensor's peak."""
    rows = []
    for effect in found.effects:
        most, own = effect.worst if effect.differences else None, ("needed", "operations", "reason")
        change = {"change": most and most.error, "worst_sensor": most and most.sensor, "rms": most and most.rms_error}
        about: Row = {"group": effect.group.name, "meaning": effect.group.meaning}
        rows.append(about | change | {name: getattr(effect, name) for name in own})
    pairs = zip(rows, found.effects, strict=True)
    groups = [row | {"sensors": _shares(effect.differences)} for row, effect in pairs]
    return {"operations": found.operations, "groups": groups}, rows


def _shares(found: Sequence[Difference]) -> dict[str, dict[str, float | None]]:
    return {
        each.sensor: {"peak": each.error, "rms": each.rms_error, "with": each.reference_peak, "without": each.peak}
        for each in found
    }
