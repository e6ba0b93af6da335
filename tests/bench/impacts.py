"""Section: impacts a second of one core, and a mass on a stop against Exudyn and its closed form.

Timed is solving alone, without compiling, building or reading of sensors.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
from machines import machine

from bench.interleave import Timed, interleave
from bench.rows import Row, Target
from kaneflex import Model, load, scene_of, with_settings
from kaneflex.solve.simulation import solve

TITLE = "Impacts"
ABOUT = """\
*One impact* is the processor time of a run divided by its number of impacts, at the default tolerance, for a ball that
bounces without loss and for a slider-crank at 3000 rpm with clearance at its wrist pin. *A mass on a stop* falls about
ten times onto a linear spring. Exudyn (ObjectContactCoordinate, generalised-alpha) uses fixed steps; kaneflex locates
the impacts. The error is the rms difference from the closed form at 60 instants; the ratio is to kaneflex."""
ROUNDS = 5
G = 9.81
BALL = machine(
    description="A ball that bounces on the floor", gravity=[0, "-9.81 m/s^2"], bodies=dict(ball='mass = "1 kg"'),
    joints=dict(fall="prismatic ground ball, direction = [0, 1]"), drives=dict(fall='free = true, position = "1 mm"'),
    contacts=dict(floor='point_on_line = ["ball", "ground"], normal = [0, 1], contact = CONTACT'),
    sensors=dict(height="position fall x"), solve=dict(preset="coupled", duration="60 s", steps=10),
)
CRANK = machine(
    description="A slider-crank with room in its wrist pin",
    bodies=dict(crank='length = "50 mm", mass = "0.3 kg", inertia = "1e-4 kg m^2"',
                rod='length = "120 mm", mass = "68 g", inertia = "8.2e-5 kg m^2", centre = ["60 mm", 0]',
                piston='mass = "0.14 kg"'),
    joints=dict(main="revolute ground crank", pin="revolute crank.end rod",
                bore="prismatic ground piston, direction = [1, 0]",
                wrist='revolute rod.end piston, clearance = {radial = "0.2 mm", contact = CONTACT}'),
    drives=dict(main='speed = "3000 rpm"', pin='free = true, initial_speed = "-4250 rpm"',
                bore='free = true, position = "170 mm"'),
    sensors=dict(slide="position bore x"), solve=dict(preset="coupled", duration="0.2 s", steps=20),
)
NEWTON, HERTZ = Target(reach=10e-6, dream=5e-6), Target(reach=100e-6, dream=50e-6)
CASES = {
    "one impact of a ball": (BALL, {
        "Newton's law": (NEWTON, '{law = "newton", restitution = 1}'),
        "Hertz's law": (HERTZ, '{law = "hertz", stiffness = 1e9}'),
    }),
    "one impact of a slider-crank": (CRANK, {
        "Newton's law": (NEWTON, '{law = "newton", restitution = 0.9}'),
        "exact restitution": (HERTZ, "{stiffness = 1e10, restitution = 0.9}"),
    }),
}  # fmt: skip
STIFFNESS, HEIGHT, DURATION, INSTANTS = 1e5, 0.05, 2.0, 60
"""Of a mass of 1 kg on a stop [N/m, m, s]."""
STOP = BALL.replace("CONTACT", f'{{law = "hertz", stiffness = {STIFFNESS}, exponent = 1}}')
FALL = f"fall.position={HEIGHT}", f"solve.duration={DURATION}", f"solve.steps={INSTANTS}"
ERRORS = 1e-3, 1e-5
TOLERANCES = tuple(10.0 ** (-k / 2) for k in range(4, 21))
STEPS = tuple(1000 * 2**k for k in range(9))
Answer = Callable[[float], tuple[np.ndarray, np.ndarray, float]]
"""Instants, heights and seconds of a run with so many steps, or at such a tolerance."""


def rows() -> Iterator[Row]:
    for task, (text, laws) in CASES.items():
        impacts = {law: an_impact(text.replace("CONTACT", contact)) for law, (_, contact) in laws.items()}
        race = interleave({law: timed for law, (timed, _) in impacts.items()}, ROUNDS)
        for law, (target, _) in laws.items():
            yield Row(task, law, race[law], None, target, of_time=True, differs=f"{impacts[law][1]} impacts")
    try:
        import exudyn  # noqa: F401 - which by_exudyn takes
    except ImportError:
        yield Row("a mass on a stop", "Exudyn", None, missing="exudyn is not installed")
        return
    for error in ERRORS:
        yield from raced(error)


@cache
def made(text: str, *settings: str) -> Model:
    """The model of a scene's text."""
    return load(with_settings(scene_of(text), list(settings)))


def an_impact(text: str) -> tuple[Timed, int]:
    """Seconds of the core an impact of a scene, and how many it has."""
    model = made(text)
    count = len(solve(model).impacts)

    def seconds() -> float:
        started = time.process_time()
        solve(model)
        return (time.process_time() - started) / count

    return seconds, count


def raced(error: float) -> Iterator[Row]:
    """Both programs at the coarsest resolution that is within the error, in turn."""
    answers: dict[str, tuple[Answer, tuple[float, ...]]] = {
        "kaneflex": (by_kaneflex, TOLERANCES), "Exudyn": (by_exudyn, STEPS)
    }  # fmt: skip
    chosen = {name: coarsest(error, answer, efforts) for name, (answer, efforts) in answers.items()}
    race = interleave({name: lambda name=name: answers[name][0](chosen[name][0])[2] for name in answers}, ROUNDS)
    for name, (effort, found) in chosen.items():
        work = f"a tolerance of {effort:.0e}" if name == "kaneflex" else f"{effort:.0f} steps"
        ratio = race.ratio(name, "kaneflex")
        yield Row(f"a mass on a stop, {error:g}", name, race[name], ratio, differs=f"{work}, error {found:.1e}")


def coarsest(error: float, answer: Answer, efforts: tuple[float, ...]) -> tuple[float, float]:
    """The effort of the coarsest run that is within the error, and its own."""
    for effort in efforts:
        times, heights, _ = answer(effort)
        expected = height(times)
        found = float(np.sqrt(np.mean((heights - expected) ** 2)) / abs(expected).max())
        if found <= error:
            return effort, found
    raise ValueError(f"no run is within {error:g}")


def height(t: np.ndarray) -> np.ndarray:
    """Of the mass [m] at times [s]: a parabola, then half a period and more of the spring about its weight's sag."""
    sag, speed, omega = G / STIFFNESS, math.sqrt(2 * G * HEIGHT), math.sqrt(STIFFNESS)
    flight, phase = 2 * speed / G, math.atan2(speed / omega, sag)
    contact = 2 * (math.pi - phase) / omega
    s = (t + flight / 2) % (flight + contact)
    deep = math.hypot(sag, speed / omega) * np.cos(omega * (s - flight) + phase) - sag
    return np.where(s < flight, speed * s - G * s**2 / 2, deep)


def by_kaneflex(tolerance: float) -> tuple[np.ndarray, np.ndarray, float]:
    model = made(STOP, *FALL, f"solve.tolerance={tolerance}")
    solution = solve(model)
    return solution.times, solution.series["height"].values, solution.seconds


def by_exudyn(steps: float) -> tuple[np.ndarray, np.ndarray, float]:
    import exudyn
    from exudyn import itemInterface as item

    mbs = exudyn.SystemContainer().AddSystem()
    node = mbs.AddNode(item.Node1D(referenceCoordinates=[0.0], initialCoordinates=[HEIGHT]))
    mbs.AddObject(item.Mass1D(mass=1.0, nodeNumber=node))
    mass = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
    floor = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(item.NodePointGround()), coordinate=0))
    mbs.AddLoad(item.LoadCoordinate(markerNumber=mass, load=-G))
    state = mbs.AddNode(item.NodeGenericData(initialCoordinates=[1.0], numberOfDataCoordinates=1))
    mbs.AddObject(
        item.ObjectContactCoordinate(markerNumbers=[floor, mass], nodeNumber=state, contactStiffness=STIFFNESS)
    )
    read = item.SensorNode(
        nodeNumber=node, storeInternal=True, outputVariableType=exudyn.OutputVariableType.Coordinates
    )
    sensor = mbs.AddSensor(read)
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime, integration.verboseMode = int(steps), DURATION, 0
    integration.generalizedAlpha.spectralRadius = 1.0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = DURATION / INSTANTS
    started = time.perf_counter()
    mbs.SolveDynamic(settings)
    seconds = time.perf_counter() - started
    found = np.array(mbs.GetSensorStoredData(sensor))
    return found[:, 0], found[:, 1], seconds
