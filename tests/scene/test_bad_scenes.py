"""Bad scenes: one change of the reference engine each, and the exact message that a user gets."""

import pytest

from kaneflex import SceneError, read_scene, scene_of, shipped_scenes, with_settings
from kaneflex.mechanism.rigid_bodies import check_elastic
from kaneflex.scene.options import resolve_options

ENGINE = shipped_scenes()["engine"]
GAS = (ENGINE.parent / "gas.csv").read_text()
LENGTH = 'length = "137 mm"'
CRANK_PIN = 'pin = {revolute = ["crank.end", "rod.start"]}'

# key of the case: what is replaced (once; nothing: at the end), by what, and the message; {folder} is the scene's.
BAD = {
    "unknown key": (LENGTH, 'lenght = "137 mm"',
        "bodies.rod.lenght = '137 mm': unknown key. The nearest known one is 'length'."),
    "unknown table": ("[damping]", "[dampings]", "dampings: unknown key. The nearest known one is 'damping'."),
    "missing schema": ("schema = 1\n", "\n", "schema: missing. Write schema = 1 first."),
    "other schema": ("schema = 1", "schema = 2", "schema = 2: must be 1. Write 1."),
    "wrong dimension": (LENGTH, 'length = "137 kg"',
        "bodies.rod.length = '137 kg': 'kg' is not a unit of length. "
        "Write a length like '137 mm', or a plain number in m."),
    "unknown unit": (LENGTH, 'length = "137 mmm"',
        "bodies.rod.length = '137 mmm': unknown unit 'mmm'. The nearest known one is 'mm'."),
    "code for a unit": (LENGTH, "length = \"1 __import__('os')\"",
        "bodies.rod.length = \"1 __import__('os')\": unknown unit \"__import__('os')\". Known: %, GPa, Hz, MPa, N, N "
        "m, N m s/rad, N m/rad, N s/m, N s/m^2, N/m, Pa, bar, cm, deg, g, kHz, kN, kN/m, kg, kg m^2, kg mm^2, kg/m^3, "
        "m, m/s, m/s^2, m^2, m^4, mm, mm^2, mm^4, ms, rad, rad/s, rpm, s, um."),
    "no unit": (LENGTH, 'length = "137"',
        "bodies.rod.length = '137': no unit; a length is required. "
        "Write a length like '137 mm', or a plain number in m."),
    "not a number": (LENGTH, "length = true",
        "bodies.rod.length = True: a length is required. Write a length like '137 mm', or a plain number in m."),
    "infinite": (LENGTH, "length = inf",
        "bodies.rod.length = inf: not a finite number. Write a length like '137 mm', or a plain number in m."),
    "too large to be multiplied": (LENGTH, 'length = "1e61 m"',
        "bodies.rod.length = '1e61 m': outside 1e-60 to 1e+60: products of such numbers exceed double precision. "
        "Write a length like '137 mm', or a plain number in m."),
    "too small to be multiplied": (LENGTH, "length = 1e-300",
        "bodies.rod.length = 1e-300: outside 1e-60 to 1e+60: products of such numbers exceed double precision. "
        "Write a length like '137 mm', or a plain number in m."),
    "zero length": (LENGTH, "length = 0",
        "bodies.rod.length = 0: a length must be above zero. Write one like '137 mm'."),
    "negative length": (LENGTH, 'length = "-1 mm"',
        "bodies.rod.length = '-1 mm': a length must be above zero. Write one like '137 mm'."),
    "negative mass": ('mass = "0.153 kg"', 'mass = "-0.153 kg"',
        "bodies.rod.mass = '-0.153 kg': a mass must be above zero. Write one like '0.153 kg'."),
    "zero mass": ('mass = "0.214 kg"', "mass = 0",
        "bodies.piston.mass = 0: a mass must be above zero. Write one like '0.153 kg'."),
    "negative inertia": ('mass = "0.214 kg"', "mass = 1, inertia = -1",
        "bodies.piston.inertia = -1: a moment of inertia must not be negative. Write one like '120 kg mm^2'."),
    "zero E": ("elements = 4", "E = 0",
        "bodies.rod.beam.E = 0: a modulus must be above zero. Write one like '210 GPa'."),
    "negative A": ("elements = 4", "A = -2",
        "bodies.rod.beam.A = -2: an area must be above zero. Write one like '142.3 mm^2'."),
    "zero I": ('I = "7008 mm^4"', "I = 0",
        "bodies.rod.beam.I = 0: a second moment of area must be above zero. Write one like '7008 mm^4'."),
    "missing I": ('I = "7008 mm^4", ', "", "bodies.rod.beam.I: missing. Give I, or a section by its shape."),
    "no elements": ("elements = 4", "elements = 0",
        "bodies.rod.beam.elements = 0: too few. Write a whole number of one or more."),
    "half an element": ("elements = 4", "elements = 1.5",
        "bodies.rod.beam.elements = 1.5: not a whole number. Write a whole number of one or more."),
    "unknown material": ('material = "steel"', 'material = "steal"',
        "bodies.rod.beam.material = 'steal': unknown material. The nearest known one is 'steel'."),
    "no material": ('material = "steel", ', "",
        "bodies.rod.beam: neither a material nor both E and rho. Give material, one of steel, aluminium, titanium."),
    "mass against area": ("elements = 4", 'A = "142 mm^2"',
        "bodies.rod.mass = '0.153 kg': the beam's rho A length is 0.152714 kg. Give either mass or A."),
    "mass against section": ('I = "7008 mm^4"', 'section = {rectangle = ["20 mm", "12 mm"]}',
        "bodies.rod.mass = '0.153 kg': the beam's rho A length is 0.258108 kg. Leave mass out: sections give it."),
    "neither mass nor area": ('mass = "0.153 kg", ', "",
        "bodies.rod.beam: neither the body's mass nor the beam's A. Give one of them."),
    "beam without length": (LENGTH + ", ", "", "bodies.rod.length: an elastic body without length. Give its length."),
    "centre of a beam": (LENGTH, LENGTH + ", centre = [0, 0]",
        "bodies.rod.centre = [0, 0]: a uniform beam gives it already. Leave centre out."),
    "own point again": (LENGTH, LENGTH + ", points = {mid = [1, 0]}",
        "bodies.rod.points.mid = [1, 0]: every body has this point. Choose another name."),
    "three components": (LENGTH, LENGTH + ", points = {top = [1, 0, 0]}",
        "bodies.rod.points.top = [1, 0, 0]: three components, where joints.bore.direction has two. Give all vectors of "
        "a scene three components in space, two in the plane."),
    "fixed points in a table": ("[bodies]", "[ground]\npoints = {far = [1, 0]}\n[bodies]",
        "ground.points: a fixed point is a vector, not a table. Write points directly under ground, like far = "
        "[0.1, 0]."),
    "law with a pole": ('speed = "6000 rpm", cycle = "720 deg"', 'law = "tan(100 * t)", period = "20 ms"',
        "drives.main.law = 'tan(100 * t)': it grows without bound at t = 0.015708 s. Give a law that is finite over "
        "the run, or another duration."),
    "reserved name": ("[bodies]", "[bodies]\npi = {mass = 1}",
        "bodies.pi: a reserved name: laws use it. Choose another name."),
    "sensor over itself": ("[sensors]", '[sensors]\ntime = {position = "rod"}',
        "sensors.time: a reserved name: it names the time axis of the results. Choose another name."),
    "key of a table within": (LENGTH, LENGTH + ", elements = 3",
        "bodies.rod.elements = 3: unknown key. It belongs to bodies.rod.beam."),
    "key of the table around": ("elements = 4", 'length = "1 m"',
        "bodies.rod.beam.length = '1 m': unknown key. It belongs to bodies.rod."),
    "key of another table": ('cycle = "720 deg"', 'cycle = "720 deg", preset = "rigid"',
        "drives.main.preset = 'rigid': unknown key. It belongs to solve."),
    "capitals that could be milli": ("elements = 4", 'E = "210 mpa"',
        "bodies.rod.beam.E = '210 mpa': unknown unit 'mpa'. Write 'MPa': capitals count."),
    "capitals of another unit": (LENGTH, 'length = "137 MM"',
        "bodies.rod.length = '137 MM': 'MM' is not a unit of length. Write 'mm': capitals count."),
    "no name": ("[bodies]", '[bodies]\n"a b" = {mass = 1}',
        "bodies.a b: not a name. Use letters, digits and underscores, a letter first."),
    "letters beyond ASCII in a name": ("[bodies]", '[bodies]\n"größe" = {mass = 1}',
        "bodies.größe: not a name. Use letters, digits and underscores, a letter first."),
    "body that is no table": ("[bodies]", "[bodies]\nflywheel = 3",
        "bodies.flywheel = 3: not a table. Write a table, like {key = value}."),
    "like an unknown body": ("[bodies]", '[bodies]\nlever = {like = "rodd"}',
        "bodies.lever.like = 'rodd': no body of that name. The nearest known one is 'rod'."),
    "like itself": ("[bodies]", '[bodies]\nlever = {like = "lever"}',
        "bodies.lever.like = 'lever': bodies refer to each other in a circle. Remove one reference."),
    "unknown point": ('"crank.end"', '"crank.ende"',
        "joints.pin.revolute = 'crank.ende': crank has no point 'ende'. The nearest known one is 'end'."),
    "unknown body": ('"crank.end"', '"crnk.end"',
        "joints.pin.revolute = 'crnk.end': there is no body 'crnk'. The nearest known one is 'crank'."),
    "unknown fixed point": ('["ground", "crank.start"]', '["ground.far", "crank.start"]',
        "joints.main.revolute = 'ground.far': no such fixed point. Known: origin."),
    "one side": ('["crank.end", "rod.start"]', '["crank.end"]',
        "joints.pin.revolute = ['crank.end']: a joint has two sides. "
        "Write two addresses, like ['crank.end', 'rod.start']."),
    "joint on itself": ('["crank.end", "rod.start"]', '["crank.end", "crank.start"]',
        "joints.pin.revolute = ['crank.end', 'crank.start']: both sides are on the same body. Join two bodies."),
    "two kinds of joint": (CRANK_PIN, CRANK_PIN[:-1] + ', weld = ["rod", "piston"]}',
        "joints.pin: revolute and weld exclude each other. Give exactly one of revolute, prismatic, weld, cylindrical, "
        "universal, spherical."),
    "no kind of joint": (CRANK_PIN, 'pin = {rotation = "shared"}',
        "joints.pin: none of revolute, prismatic, weld, cylindrical, universal, spherical is given. Give exactly one "
        "of revolute, prismatic, weld, cylindrical, universal, spherical."),
    "branch where no loop closes": (CRANK_PIN, CRANK_PIN[:-1] + ', branch = "+"}',
        "joints.pin.branch = '+': this joint closes no loop. Give branch at bore."),
    "branch where a joint is missing": ('wrist = {revolute = ["rod.end", "piston"]}\n', "",
        "joints.bore.branch = '+': no loop is closed: rod has only joint pin, piston has only joint bore. "
        "Add the missing joint, like pin = {revolute = [\"rod.end\", \"piston\"]}, or leave branch out."),
    "branch that is none": ('branch = "+"', 'branch = "up"',
        "joints.bore.branch = 'up': must be '+' or '-'. Write one of these."),
    "guide without direction": ("direction = [1, 0], ", "",
        "joints.bore: a prismatic joint slides along a direction. "
        "Give it, like direction = [1, 0], in space [1, 0, 0]."),
    "zero direction": ("direction = [1, 0]", "direction = [0, 0]",
        "joints.bore.direction = [0, 0]: a direction must not be zero. Write two components, like [1, 0], or three in "
        "space."),
    "joint with a body's name": ("wrist = ", "rod = ", "joints.rod: a body has the same name. Choose another name."),
    "turns in Hz": ('speed = "6000 rpm"', 'speed = "100 Hz"',
        "drives.main.speed = '100 Hz': 'Hz' is not a unit of angular speed. "
        "Write an angular speed like '6000 rpm', or a plain number in rad/s."),
    "part of a turn": ('cycle = "720 deg"', 'cycle = "700 deg"',
        "drives.main.cycle = '700 deg': the mechanism repeats only after whole turns. Give a multiple of 360 deg."),
    "cycle against table": ('cycle = "720 deg"', 'cycle = "360 deg"',
        "loads.gas.period = '720 deg': the cycle is not a multiple of it, so there is no common period. "
        "Give a period that divides the cycle."),
    "no horizon": (', cycle = "720 deg"', "",
        "solve.duration: no rotating drive has a cycle, and solve.duration is missing. "
        "Give solve.duration, or a cycle to the drive.\n"
        "solve.start = 'periodic': no rotating drive has a cycle. Give the drive a cycle."),
    "drive of no joint": ("[drives]", "[drives]\npins = {speed = 1}",
        "drives.pins: no joint of that name to drive. The nearest known one is 'pin'."),
    "force on the ground": ('force_on = "piston"', 'force_on = "ground"',
        "loads.gas.force_on = 'ground.origin': the ground does not move. Name a point of a body."),
    "no such column": ('"F_gas_N"', '"F_gas"',
        "loads.gas.column = 'F_gas': gas.csv does not have this column. The nearest known one is 'F_gas_N'."),
    "pressure for a force": ('unit = "N"', 'unit = "bar"',
        "loads.gas.unit = 'bar': 'bar' is not a unit of force. Write a force like '1.2 kN', or a plain number in N."),
    "against no drive": ('against = "main"', 'against = "mian"',
        "loads.gas.against = 'mian': no joint or speed of that name. The nearest known one is 'main'."),
    "against nothing": ('against = "main"\n', "",
        "loads.gas: the table's abscissa is not given. Give against: 't', a joint's name, or "
        "NAME_speed for its speed."),
    "half a table": ('period = "720 deg"', 'period = "1440 deg"',
        "loads.gas.table = '{folder}/gas.csv': the table covers 0.5 of its period. "
        "Cover the period once, with or without its first row repeated at the end."),
    "period in seconds": ('period = "720 deg"', 'period = "1 s"',
        "loads.gas.period = '1 s': 's' is not a unit of angle. "
        "Write an angle like '720 deg', or a plain number in rad."),
    "no period": ('period = "720 deg"\n', "",
        "loads.gas.period: a periodic start needs periodic tables. Give the table's period."),
    "missing table": ('"gas.csv"\n', '"gaz.csv"\n',
        "loads.gas.table = '{folder}/gaz.csv': no such file. Give the path of a CSV file, relative to the "
        "scene's file."),
    "two sizes of a load": ("[loads.gas]", "[loads.gas]\nvalue = 3",
        "loads.gas: value and table exclude each other. Give exactly one of value, law, table."),
    "law that calls": ("[loads.gas]", "[loads.push]\nforce_on = \"rod.mid\"\ndirection = [0, 1]\nlaw = "
        "\"open('x')\"\n[loads.gas]",
        "loads.push.law = \"open('x')\": a law cannot call 'open'. "
        "Use abs, acos, asin, atan, atan2, cos, exp, log, max, min, sign, sin, sqrt, step, tan, tanh."),
    "two dampings": ("[damping]", "[damping]\nviscous = {mu = 1}",
        "damping: rayleigh and viscous exclude each other. Give exactly one of rayleigh, modal, viscous."),
    "falling frequencies": ('at = ["3039 Hz", "4549 Hz"]', "at = [2, 1]",
        "damping.rayleigh.at = [2, 1]: the frequencies must be positive and increasing. "
        "Write them like at = ['3039 Hz', '4549 Hz']."),
    "unknown sensor key": ("[sensors]", '[sensors]\nlift = {displacment = "rod.mid"}',
        "sensors.lift.displacment = 'rod.mid': unknown key. The nearest known one is 'displacement'."),
    "unknown sensor point": ('rod_mid_force = {axial_force = "rod.mid"', 'rod_mid_force = {axial_force = "rod.middle"',
        "sensors.rod_mid_force.axial_force = 'rod.middle': rod has no point 'middle'. The nearest known one is 'mid'."),
    "strain of a rigid body": ('strain = "rod.mid"', 'strain = "crank.mid"',
        "sensors.rod_mid_strain.strain = 'crank.mid': crank is rigid. Give the body a beam."),
    "strain without fibre": (', fibre = "10 mm"', "",
        "sensors.rod_mid_strain: the strain's fibre is not given. Give fibre, its height above the axis."),
    "force of no joint": ('joint_force = "bore"', 'joint_force = "boer"',
        "sensors.piston_side_force.joint_force = 'boer': no joint of that name. The nearest known one is 'bore'."),
    "force on another body": ('joint_force = "bore"', 'joint_force = "bore", body = "rod"',
        "sensors.piston_side_force.body = 'rod': bore joins ground and piston. Name one of them."),
    "torque of no drive": ('drive_torque = "main"', 'drive_torque = "pin"',
        "sensors.crank_torque.drive_torque = 'pin': no drive of that name. Known: main."),
    "meaningless component": ('axial_force = "rod.end"', 'axial_force = "rod.end", component = "y"',
        "sensors.rod_force_piston.component = 'y': does not apply to axial_force. Leave it out."),
    "name of a rigid companion": ("[sensors]", '[sensors]\ncrank_torque_rigid = {position = "rod"}',
        "sensors.crank_torque_rigid: the value of crank_torque in the rigid mechanism has this name. "
        "Choose another name."),
    "spring without stiffness": ("", '[springs]\nband = {between = ["ground", "crank.end"]}',
        "springs.band: stiffness and damping are missing. Give at least one of them."),
    "spring on one body": ("", '[springs]\nband = {between = ["crank.start", "crank.end"], stiffness = 1}',
        "springs.band.between = ['crank.start', 'crank.end']: both ends are on the same body. "
        "Name points of two bodies."),
    "spring across a pin": ("", '[springs]\nband = {between = ["rod.start", "crank.end"], damping = 1}',
        "springs.band.between = ['rod.start', 'crank.end']: joint pin keeps its points together, so forces by length "
        "or damping have no direction. Move one of the points, give only stiffness, or write torsional_at for a "
        "torsional spring."),
    "mass of nothing": ("", '[masses]\nlump = {at = "rod.mid"}',
        "masses.lump: neither mass nor inertia. Give at least one of them."),
    "I beside J": ('I = "7008 mm^4"', 'I = "7008 mm^4", J = "1 mm^4"',
        "bodies.rod.beam.I = '7008 mm^4': a section in space has I_y, I_z and J, one in the plane only I. "
        "Leave I out in space, J in the plane."),
    "J alone": ('I = "7008 mm^4"', 'J = "1 mm^4"',
        "bodies.rod.beam.I_y: missing: a section in space has I_y, I_z and J, one in the plane only I. "
        "Give all three in space, I in the plane."),
    "spring to nowhere": ("", '[springs]\nband = {between = ["ground", "crank.ende"], stiffness = 1}',
        "springs.band.between = 'crank.ende': crank has no point 'ende'. The nearest known one is 'end'."),
    "negative stiffness": ("", '[springs]\nband = {between = ["ground", "crank"], stiffness = "-1 N/m"}',
        "springs.band.stiffness = '-1 N/m': a stiffness must not be negative. Write one like '20 kN/m'."),
    "torsional spring in N/m": ("", '[springs]\nband = {torsional_at = "main", stiffness = "1 N/m"}',
        "springs.band.stiffness = '1 N/m': 'N/m' is not a unit of torsional stiffness. "
        "Write a torsional stiffness like '12 N m/rad', or a plain number in N m/rad."),
    "free length of a torsional spring": ("", '[springs]\nband = {torsional_at = "main", stiffness = 1, length = 1}',
        "springs.band.length = 1: does not apply to torsional_at. Leave it out."),
    "torsional spring at no joint": ("", '[springs]\nband = {torsional_at = "maim", stiffness = 1}',
        "springs.band.torsional_at = 'maim': no joint of that name. The nearest known one is 'main'."),
    "torsional spring on a guide": ("", '[springs]\nband = {torsional_at = "bore", stiffness = 1}',
        "springs.band.torsional_at = 'bore': a prismatic joint does not turn. Name a revolute joint."),
    "spring with a joint's name": ("", '[springs]\nmain = {torsional_at = "main", stiffness = 1}',
        "springs.main: joints has an entry of this name. Choose another name."),
    "torque of a straight spring": ("[sensors]", '[springs]\nband = {between = ["ground", "crank.end"], stiffness = 1}'
        '\n[sensors]\nm = {spring_torque = "band"}',
        "sensors.m.spring_torque = 'band': a linear spring has no spring_torque. Write spring_force."),
    "force of no spring": ("[sensors]", '[springs]\nband = {between = ["ground", "crank.end"], stiffness = 1}'
        '\n[sensors]\nm = {spring_force = "bnd"}',
        "sensors.m.spring_force = 'bnd': no spring of that name. The nearest known one is 'band'."),
    "unknown preset": ('"stiffened"', '"stiffend"',
        "solve.preset = 'stiffend': unknown preset. The nearest known one is 'stiffened'."),
    "a number for a term": ("[solve]", "[solve]\nterms = {geometric = 1}",
        "solve.terms.geometric = 1: neither true nor false. Write true or false, without quotes."),
    "unknown term": ("[solve]", "[solve]\nterms = {gyro = false}",
        "solve.terms.gyro = False: unknown term. Known: damping, euler, geometric, gravity, gyroscopic, rotary, shear, "
        "spin."),
    "no modes": ("[solve]", "[solve]\nmodes = 0", "solve.modes = 0: too few. Write a whole number of one or more."),
    "a tolerance of the forward dynamics beyond rounding": ("[solve]", "[solve]\nforward = {tolerance = 1e-15}",
        "solve.forward.tolerance = 1e-15: not between 1e-13 (rounding) and 1. Give a number in this range, like 1e-9."),
    "a tolerance beyond rounding": ("[solve]", "[solve]\ntolerance = 1e-16",
        "solve.tolerance = 1e-16: not between 1e-13 (rounding) and 1. Give a number in this range, like 1e-9."),
    "unknown integrator": ("[solve]", '[solve]\nintegrator = "rk4"',
        "solve.integrator = 'rk4': must be 'spectral', 'radau', 'newmark', 'generalised-alpha', 'gauss' or "
        "'exact-modal'. Write one of these."),
    "gravity as a speed": ("schema = 1", 'schema = 1\ngravity = [0, "9.81 m/s"]',
        "gravity = [0, '9.81 m/s']: 'm/s' is not a unit of acceleration. "
        "Write an acceleration like '9.81 m/s^2', or a plain number in m/s^2."),
    "broken TOML": ("schema = 1", "schema = ",
        "scene = 'bad.toml': line 4 is not TOML: schema = (Invalid value (at line 4, column 10)). "
        "Write lines like key = \"50 mm\", or headers like [bodies.rod]."),
    "a unit without quotes": (LENGTH, "length = 137 mm",
        'scene = \'bad.toml\': line 17 is not TOML: rod = {length = 137 mm, mass = "0.153 kg", beam = {material = '
        '"steel", I = "7008 mm^4", elements = 4}}. Write a number with a unit in quotes, like "50 mm".'),
    "a decimal comma in a unit": (LENGTH, 'length = "137,5 mm"',
        "bodies.rod.length = '137,5 mm': unknown unit ',5 mm'. "
        "Write a point, as 50.5 mm, where a comma separates decimals."),
    "a misspelled unit": (LENGTH, 'length = "137 milimeters"',
        "bodies.rod.length = '137 milimeters': unknown unit 'milimeters'. Write 'mm'."),
    "like an unknown scene": ("schema = 1", 'schema = 1\nlike = "engin"',
        "like = 'engin': no shipped scene and no file of that name. The nearest known one is 'engine'."),
    "like itself as a scene": ("schema = 1", 'schema = 1\nlike = "bad.toml"',
        "like = 'bad': scenes refer to each other in a circle: bad.toml -> bad.toml. Remove one reference."),
    "drive of a scene with poses": (
        'piston = {mass = "0.214 kg"}', 'piston = {mass = "0.214 kg", pose = {at = [0, 0]}}',
        "bodies.crank.pose: other bodies have poses, this one has none. Give its pose.\n"
        "bodies.rod.pose: other bodies have poses, this one has none. Give its pose.\n"
        "drives.main: bodies with poses don't move. Leave out either the drive or the poses."),
    "chord of a body without length": ('tip_axial = {displacement = "rod.end", relative_to = "start"',
        'tip_axial = {displacement = "piston.start", relative_to = "chord"',
        "sensors.tip_axial.relative_to = 'chord': piston has no length. Give the body a length."),
    "cycles of different times": ('main = {speed = "6000 rpm", cycle = "720 deg"}\n',
        'main = {speed = "6000 rpm", cycle = "720 deg"}\npin = {law = "t", period = "0.05 s"}\n',
        "drives.pin.period = '0.05 s': this cycle takes 0.05 s, another drive's 0.02 s. Give cycles that "
        "take the same time."),
    "name of a point": ('crank = {length = "40 mm", ', 'crank = {length = "40 mm", points = {"big end" = [0, 0]}, ',
        "bodies.crank.points.big end: not a name. Use letters, digits and underscores."),
    "torque at no joint": ("", '[loads.motor]\ntorque_at = "mian"\nvalue = 1',
        "loads.motor.torque_at = 'mian': no joint of that name. The nearest known one is 'main'."),
    "torque at a guide": ("", '[loads.motor]\ntorque_at = "bore"\nvalue = 1',
        "loads.motor.torque_at = 'bore': a prismatic joint does not turn. Name a revolute joint."),
    "torque with a direction": ("", '[loads.motor]\ntorque_at = "main"\nvalue = 1\ndirection = [1, 0]',
        "loads.motor.direction = [1, 0]: a torque has no direction. Leave it out."),
    "force without direction": ("", '[loads.wind]\nforce_on = "piston"\nvalue = 1',
        "loads.wind.direction: the force has no direction. Give it, like direction = [1, 0], in space [1, 0, 0]."),
    "constant load with a period": ("[loads.gas]",
        '[loads.wind]\nforce_on = "piston"\ndirection = [1, 0]\nvalue = 1\nperiod = "1 deg"\n[loads.gas]',
        "loads.wind.period = '1 deg': belongs to a table; this load has a value. Leave it out."),
    "negative period of a table": ('period = "720 deg"', 'period = "-720 deg"',
        "loads.gas.period = '-720 deg': not positive. Give a positive period, like '720 deg'."),
    "speed with a period": (
        'main = {speed = "6000 rpm", cycle = "720 deg"}', 'main = {speed = "6000 rpm", period = "0.02 s"}',
        "drives.main.period = '0.02 s': a drive by speed repeats after a cycle, not a period. Leave period out."),
    "spin-up with a cycle": ('main = {speed = "6000 rpm", cycle = "720 deg"}',
        'main = {speed = "6000 rpm", spin_up = "1 s", cycle = "720 deg"}',
        "drives.main.cycle = '720 deg': a drive that spins up does not repeat. Leave it out."),
    "law with an angle": ('main = {speed = "6000 rpm", cycle = "720 deg"}', 'main = {law = "t", angle = "1 deg"}',
        "drives.main.angle = '1 deg': the law already gives the joint's start. Leave it out."),
    "speed with a column": (
        'main = {speed = "6000 rpm", cycle = "720 deg"}', 'main = {speed = "6000 rpm", column = "angle"}',
        "drives.main.column = 'angle': belongs to a table; this drive has a speed. Leave it out."),
    "revolute joint with a direction": ('pin = {revolute = ["crank.end", "rod.start"]}',
        'pin = {revolute = ["crank.end", "rod.start"], direction = [1, 0]}',
        "joints.pin.direction = [1, 0]: a revolute joint has no direction. Leave it out."),
    "revolute joint with an angle": ('pin = {revolute = ["crank.end", "rod.start"]}',
        'pin = {revolute = ["crank.end", "rod.start"], relative_angle = "1 deg"}',
        "joints.pin.relative_angle = '1 deg': a revolute joint has no angle. Leave it out."),
    "spectral radius above one": ("[solve]", "[solve]\nrho_infinity = 1.1",
        "solve.rho_infinity = 1.1: above one the integrator would be unstable. Give a number from 0 to 1."),
    "direction of three components": ("direction = [-1, 0]", "direction = [-1, 0, 0]",
        "loads.gas.direction = [-1, 0, 0]: three components, where joints.bore.direction has two. Give all vectors of "
        "a scene three components in space, two in the plane."),
    "law as an angle": ('speed = "6000 rpm", cycle = "720 deg"', 'angle = "0.9 * sin(10*t)"',
        "drives.main.angle = '0.9 * sin(10*t)': not a plain number. Write functions of t as law, in rad or m, like "
        "law = '0.5*sin(t)'."),
    "gear": ('pin = {', 'mesh = {gear = ["main", "pin"], ratio = -2}\npin = {',
        "joints.mesh.gear = ['main', 'pin']: unknown key: there is no key that couples joints. {couple}\n"
        "joints.mesh.ratio = -2: unknown key: there is no key that couples joints. {couple}"),
    "drive over another drive": (
        'main = {speed = "6000 rpm", cycle = "720 deg"}', 'main = {table = "gas.csv", against = "bore"}',
        "drives.main.against = 'bore': unknown key: a drive's table is over time. {couple}"),
    "planar bushing": ("[damping]", "[springs.m]\nbushing = ['ground', 'rod']\nstiffness = [1, 1, 1]\n[damping]",
        "springs.m.stiffness = [1, 1, 1]: a bushing has six, and only scenes in space have bushings. Write three along "
        "x, y, z and three about them, like '20 kN/m', '12 N m/rad'. In a planar scene use two springs between "
        "separate points, along x and along y."),
    "address of three words": ('force_on = "piston"', 'force_on = "rod.end.x"',
        "loads.gas.force_on = 'rod.end.x': not an address. Write 'body', 'body.point' or 'ground'; define other "
        "points in the body's points."),
    "negative damping ratio": (
        'rayleigh = {ratio = 0.02, at = ["3039 Hz", "4549 Hz"]}', "modal = {ratio = [0.02, -0.01]}",
        "damping.modal.ratio = [0.02, -0.01]: a damping ratio must not be negative. Write one ratio like 0.02, or "
        "one for each mode."),
    "Rayleigh damping at one frequency": ('at = ["3039 Hz", "4549 Hz"]', 'at = ["3039 Hz"]',
        "damping.rayleigh.at = ['3039 Hz']: Rayleigh damping is fixed at two frequencies. Write them like "
        "at = ['3039 Hz', '4549 Hz']."),
    "words for a length": ('length = "137 mm"', 'length = "long"',
        "bodies.rod.length = 'long': not a number with a unit; a length is required. Write a length like '137 "
        "mm', or a plain number in m."),
    "drive of a weld": ('main = {revolute = ["ground", "crank.start"]}', 'main = {weld = ["ground", "crank.start"]}',
        "drives.main: a weld does not move. Drive a revolute or a prismatic joint."),
    "drive by a law with an unknown name": (
        'main = {speed = "6000 rpm", cycle = "720 deg"}', 'main = {law = "2*x", period = "1 s"}',
        "drives.main.law = '2*x': unknown name 'x'. Known: pi, t."),
    "two problems": ('elements = 4}}\npiston = {mass = "0.214 kg"}', 'elements = 0}}\npiston = {mass = "1 m"}',
        "bodies.rod.beam.elements = 0: too few. Write a whole number of one or more.\n"
        "bodies.piston.mass = '1 m': 'm' is not a unit of mass. "
        "Write a mass like '0.153 kg', or a plain number in kg."),
}  # fmt: skip


COUPLE = (
    "Let the joints be free, and couple them by laws of torques and forces in their coordinates and speeds, as "
    "'Brakes and belts' in docs/scene/loads.md does."
)


def _read_changed(folder, old, new):
    text = ENGINE.read_text()
    assert text.count(old) >= 1, f"the engine's file no longer says {old!r}"
    (folder / "bad.toml").write_text(text.replace(old, new, 1) if old else f"{text}\n{new}\n")
    (folder / "gas.csv").write_text(GAS)
    return read_scene(folder / "bad.toml")


def test_the_engine_itself_is_good_in_another_folder(tmp_path):
    assert _read_changed(tmp_path, "schema = 1", "schema = 1").bodies == read_scene("engine").bodies


@pytest.mark.parametrize("case", BAD)
def test_bad_scene(case, tmp_path):
    old, new, message = BAD[case]
    with pytest.raises(SceneError) as caught:
        _read_changed(tmp_path, old, new)
    assert str(caught.value) == message.replace("{folder}", str(tmp_path)).replace("{couple}", COUPLE)


@pytest.mark.parametrize(("change", "reason", "cure"), [
    (lambda lines: [*lines[:-1], "720,3,3000"],
     "the table is not periodic: first and last value differ by 0.073 of the largest",
     "Correct the table, or raise closing from 0.01"),
])  # fmt: skip
def test_bad_table(change, reason, cure, tmp_path):
    (tmp_path / "bad.toml").write_text(ENGINE.read_text())
    (tmp_path / "gas.csv").write_text("\n".join(change(GAS.splitlines())))
    with pytest.raises(SceneError) as caught:
        read_scene(tmp_path / "bad.toml")
    assert (caught.value.key, caught.value.value) == ("loads.gas.table", str(tmp_path / "gas.csv"))
    assert (caught.value.reason, caught.value.cure) == (reason, cure)


@pytest.mark.parametrize("name", ["x", "out", "mid", "k", "table"])
def test_a_sensor_may_have_a_word_of_the_scene_for_its_name(name):
    raw = read_scene("engine").raw
    assert name in with_settings(read_scene("engine"), [f'sensors={{{name}={{position="rod.mid"}}}}']).sensors
    assert name not in raw["sensors"]


def test_the_coordinate_of_a_weld_is_an_angle():
    welded = """schema = 1
bodies = {arm = {length = 1, mass = 1}, tool = {mass = 1}}
joints = {hub = {revolute = ["ground", "arm"]}, seat = {weld = ["arm.end", "tool"]}}
drives = {hub = {speed = 1, cycle = "360 deg"}}
sensors = {turn = {position = "seat", component = "%s"}}
"""
    assert scene_of(welded % "angle").sensors["turn"].unit == "rad"
    with pytest.raises(SceneError, match=r"sensors\.turn\.component = 'x': not a coordinate of this joint"):
        scene_of(welded % "x")


def test_a_body_between_two_clearances_has_no_joint_that_closes_a_loop():
    loose = 'clearance = {radial = 1e-4, contact = {stiffness = 1e9, restitution = 0.8}}}'
    scene = f"""schema = 1
bodies = {{arm = {{length = 1, mass = 1}}, rod = {{length = 1, mass = 1, free = {{}}}}, cart = {{mass = 1}}}}
joints.hub = {{revolute = ["ground", "arm"], branch = "+"}}
joints.rail = {{prismatic = ["ground", "cart"], direction = [1, 0]}}
joints.first = {{revolute = ["arm.end", "rod.start"], {loose}
joints.second = {{revolute = ["rod.end", "cart"], {loose}
drives = {{hub = {{speed = 1}}, rail = {{free = true}}}}
solve = {{preset = "coupled", duration = 1}}
"""
    with pytest.raises(SceneError, match="arm has only joint hub, rod has no joint, cart has only joint rail"):
        scene_of(scene)


@pytest.mark.parametrize(("written", "text"), [("6000 RPM", "6000 rpm"), ("6000 Rpm", "6000 rpm")])
def test_capitals_of_a_unit_that_can_mean_no_other(written, text):
    fast, same = (with_settings(read_scene("engine"), [f"main.speed={speed}"]) for speed in (written, text))
    assert fast.drives["main"].speed == same.drives["main"].speed


def test_a_scene_that_is_not_there_is_looked_for_beside_it(tmp_path, monkeypatch):
    (tmp_path / "compressor.toml").write_text('schema = 1\nlike = "engine"\n')
    monkeypatch.chdir(tmp_path)
    for name in ("compresor.toml", "compressor", "compresor"):
        with pytest.raises(SceneError, match=r"A similar file is 'compressor\.toml'"):
            read_scene(name)
    with pytest.raises(SceneError, match=r"A similar file is '.*compressor\.toml'"):
        read_scene(tmp_path / "compresor.toml")


@pytest.mark.parametrize("name", ["engin", "missing.toml", ""])
def test_unknown_scene(name):
    with pytest.raises(SceneError, match=r"^scene = .*([Ee]ngine|kaneflex list)"):
        read_scene(name)


@pytest.mark.parametrize(("settings", "message"), [
    (["solve.duration=1 s"],
     "solve.start = 'periodic': solve.duration replaces the cycle, so there is no period. "
     "Give a drive a cycle and no duration, or start from zero or quasistatic."),
    (["solve.reduction=craig-bampton", "solve.preset=paper"],
     "solve.reduction = 'craig-bampton': preset paper uses modes of the whole mechanism. Leave the reduction out."),
    (["solve.integrator=exact-modal"],
     "solve.integrator = 'exact-modal': the equations of preset stiffened are coupled. "
     "Use radau, generalised-alpha or newmark."),
    (["solve.integrator=newmark", "solve.preset=paper"],
     "solve.integrator = 'newmark': the equations of preset paper are decoupled. Leave the integrator out."),
])  # fmt: skip
def test_options_that_exclude_each_other(settings, message):
    with pytest.raises(SceneError) as caught:
        resolve_options(with_settings(read_scene("engine"), settings))
    assert str(caught.value) == message


def test_settings_are_a_list():
    with pytest.raises(SceneError, match=r"^settings = 'solve\.steps=9': a single text .*\['solve\.steps=9'\]\.$"):
        with_settings(read_scene("engine"), "solve.steps=9")


def test_files_that_are_not_text(tmp_path):
    (tmp_path / "bad.toml").write_text(ENGINE.read_text())
    (tmp_path / "gas.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(SceneError, match=r"^loads\.gas\.table = .*: not a text in UTF-8, from line 1 on\. Save it"):
        read_scene(tmp_path / "bad.toml")
    (tmp_path / "bad.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(SceneError, match=r"^scene = 'bad\.toml': not a text in UTF-8, from line 1 on\. Save it"):
        read_scene(tmp_path / "bad.toml")


def test_a_drive_whose_name_a_law_reads_as_a_speed(tmp_path):
    text = ENGINE.read_text().replace("pin = {revolute", "main_speed = {revolute").replace('"pin"', '"main_speed"')
    second = 'main_speed = {law = "t", period = "0.02 s"}\n\n[loads.gas]'
    (tmp_path / "bad.toml").write_text(text.replace("[loads.gas]", second))
    (tmp_path / "gas.csv").write_text(GAS)
    with pytest.raises(SceneError) as caught:
        read_scene(tmp_path / "bad.toml")
    assert str(caught.value) == (
        "drives.main_speed: laws use this name for the speed of another drive. Choose another name for the joint."
    )


@pytest.mark.parametrize(("scene", "settings", "message"), [
    ("engine", ["rod.points={ear=[0.05, 0.01]}", "loads.gas.force_on=rod.ear"],
     "loads.gas.force_on = 'rod.ear': the point lies off the axis of rod. "
     "Move the point onto the axis, between start and end, or join a rigid body there."),
    ("engine", ["rod.points={ear=[0.15, 0]}", "joints.wrist.revolute=['rod.ear', 'piston']", "solve.preset=coupled"],
     "joints.wrist.revolute = 'rod.ear': the point lies off the axis of rod. "
     "Move the point onto the axis, between start and end, or join a rigid body there."),
    ("engine", ["bodies.piston={length=0.05, beam={material='steel', I='7008 mm^4'}}"],
     "joints.bore.prismatic = 'piston': an elastic body on a guide is not supported. "
     "Join it to a guided rigid body by a revolute joint or a weld, or use preset rigid."),
    ("engine-elastic-crank", ["springs={coil={torsional_at='main', stiffness=1}}", "solve.preset=paper"],
     "springs.coil = 'main': in preset paper elastic bodies rotate freely at a drive. "
     "Use another preset, or leave the spring out."),
])  # fmt: skip
def test_what_elastic_links_can_not_have(scene, settings, message):
    with pytest.raises(SceneError) as caught:
        check_elastic(with_settings(read_scene(scene), settings))
    assert str(caught.value) == message
