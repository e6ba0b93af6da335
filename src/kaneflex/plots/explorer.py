"""Window with a slider for each varied number; its curves follow at once."""

from __future__ import annotations

import textwrap
from contextlib import suppress
from typing import TYPE_CHECKING

from matplotlib.figure import Figure
from matplotlib.widgets import Slider

from kaneflex.plots.sensors import grouped, quantity_of
from kaneflex.plots.style import GREY, PALETTE, legend_beside, new_figure, readable, styled
from kaneflex.plots.view import View, view
from kaneflex.support.errors import UserError
from kaneflex.support.escaping import picture_text, visible

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution
    from kaneflex.study.exploration import Exploration

_PANELS = 4
"""Largest number of panels if no sensors are named."""
_WIDTH, _PANEL, _SLIDER, _HEAD, _FOOT = 9.6, 1.75, 0.34, 1.3, 0.75
"""Inches: of the window, then what a panel, a slider, the title with the message, and the abscissa take in height."""
_PAUSE = 20
"""Milliseconds from a slider's move to the next solution: moves within are one."""
_LINE = 110
"""Characters of a line of the message."""
_MOST_LINES = 3


class Explorer:
    """Panels of sensors over the cycle, and the sliders below them.

    Parameters
    ----------
    figure : Figure
        Empty; of pyplot for a window, of any canvas for a picture.
    exploration : Exploration
        Its scene, as it is, is solved at once and stays in pale behind the curves.

    Attributes
    ----------
    sliders : tuple of Slider
        One for each number that is left open, in its unit.
    message : str
        Why nothing can be computed where the sliders stand, so that there are no curves but the pale ones; else what to
        know before trusting the numbers, mostly nothing.
    solution : Solution or None
        What is drawn: of where the sliders stand; None where it can't be computed.
    """

    def __init__(self, figure: Figure, exploration: Exploration) -> None:
        self.exploration, self.figure = exploration, figure
        self.message = ""
        self.solution: Solution | None = None
        scene = exploration.scene
        groups = grouped(scene, exploration.sensors or scene.sensors)
        if not exploration.sensors:
            groups = dict(list(groups.items())[:_PANELS])
        height = _HEAD + _PANEL * len(groups) + _FOOT + _SLIDER * len(exploration.open)
        figure.set_size_inches(_WIDTH, height)
        figure.suptitle(picture_text(f"{scene.name}, preset {scene.solve.preset}"), y=1.0 - 0.12 / height)
        self._text = figure.text(0.09, 1.0 - 0.36 / height, "", va="top", color=PALETTE[1])
        bottom = (_SLIDER * len(exploration.open) + _FOOT) / height
        grid = {"left": 0.09, "right": 0.77, "top": 1.0 - _HEAD / height, "bottom": bottom, "hspace": 0.42}
        axes = figure.subplots(len(groups), 1, sharex=True, squeeze=False, gridspec_kw=grid).ravel()
        self._panels = [(each, title, names) for each, (title, names) in zip(axes, groups.items(), strict=True)]
        self.sliders = tuple(self._slider(number, height) for number in range(len(exploration.open)))
        self._drawn: tuple[float, ...] | None = None
        self._waiting = False
        self._timer = figure.canvas.new_timer(interval=_PAUSE)
        self._timer.single_shot = True
        self._timer.add_callback(self.update)
        self._unchanged: View | None = None
        with suppress(UserError):  # it has no curves then
            self._unchanged = view(exploration.solve())
        self.update()

    def _slider(self, number: int, height: float) -> Slider:
        varied = self.exploration.open[number]
        place = (0.25, (0.12 + _SLIDER * (len(self.exploration.open) - 1 - number)) / height, 0.52, 0.2 / height)
        slider = Slider(
            self.figure.add_axes(place), varied.path, varied.low, varied.high, valinit=varied.start,
            valstep=1 if varied.whole else None, valfmt="%.5g " + varied.unit.replace("%", "%%"),
            color=PALETTE[0], initcolor=GREY,
        )  # fmt: skip
        slider.on_changed(self._moved)
        return slider

    @property
    def values(self) -> tuple[float, ...]:
        """Values of the sliders."""
        return tuple(float(slider.val) for slider in self.sliders)

    @property
    def settings(self) -> list[str]:
        """Settings of the sliders' scene, as path=value."""
        return self.exploration.settings(self.values)

    def _moved(self, value: float) -> None:
        # one solution for all moves of a pause: a slider that is dragged sends more than can be solved and drawn
        if not self._waiting:
            self._waiting = True
            self._timer.start()

    def update(self) -> None:
        """Solve the sliders' scene and draw it, unless it is already drawn."""
        self._waiting = False
        values = self.values
        if values == self._drawn:
            return
        self._drawn = values
        try:
            self.solution = self.exploration.solve(values)
            self.message = "\n".join(self.solution.warnings)
        except UserError as error:
            self.solution, self.message = None, str(error)
        self._text.set(text=picture_text(_short(self.message)), color=PALETTE[1] if self.solution is None else GREY)
        self._draw()
        self.figure.canvas.draw_idle()

    def _draw(self) -> None:
        """Pale curves of the unchanged scene, and those of the sliders' scene, as far as they are solved."""
        drawn = [] if self._unchanged is None else [(self._unchanged, {"alpha": 0.3, "linewidth": 0.9})]
        drawn += [] if self.solution is None else [(view(self.solution), {})]
        for axes, title, names in self._panels:
            axes.clear()
            sensor = self.exploration.scene.sensors[names[0]]
            series = [[shown.solution.series[name].values[shown.instants] for name in names] for shown, _ in drawn]
            factor, label = readable(sensor.unit, *(values for each in series for values in each))
            for (shown, style), each in zip(drawn, series, strict=True):
                for name, values, colour in zip(names, each, PALETTE, strict=False):
                    axes.plot(shown.x, factor * values, color=colour, label=None if style else name, **style)
            axes.plot([], [], color=GREY, linewidth=0.9, label="pale: the unchanged scene")
            axes.set(title=title, ylabel=f"{quantity_of(sensor)} [{label}]", xmargin=0)
            axes.tick_params(labelbottom=axes is self._panels[-1][0])
            legend_beside(axes)
        for shown, _ in drawn[-1:]:
            shown.label_x(axes)


def _short(message: str) -> str:
    lines = [line for part in message.splitlines() for line in textwrap.wrap(part, _LINE)]
    return "\n".join(lines if len(lines) <= _MOST_LINES else [*lines[: _MOST_LINES - 1], "..."])


def open_window(exploration: Exploration) -> list[str]:
    """Show the window until it is closed; returns the settings of where its sliders then stood.

    Raises
    ------
    UserError
        Where matplotlib can open no window.
    """
    import matplotlib.pyplot as plt

    with styled():
        figure = plt.figure(visible(f"kaneflex explore {exploration.scene.name}"))
        if figure.canvas.required_interactive_framework is None:
            backend = plt.get_backend()
            plt.close(figure)
            raise UserError(
                "matplotlib's backend", backend, "it opens no window",
                "Work on a screen with PyQt6 or tkinter installed, or write a picture with -o FILE.png",
            )  # fmt: skip
        explorer = Explorer(figure, exploration)
        plt.show()
    return explorer.settings


def figure(exploration: Exploration) -> Figure:
    """Window with its curves and sliders."""
    return Explorer(new_figure(_WIDTH, _WIDTH, "", layout="none"), exploration).figure
