"""Modules that kaneflex generated from its shipped scenes. Do not edit: ``make derive`` makes them."""

# Structure hash -> module. Scenes of one structure share a module.
STRUCTURES = {
    "fa1495c57f528a9c": "double_pendulum",
    "3182af0611dedf2f": "engine",
    "2a574e40531446f4": "engine_3",
    "ef1620f7351a671c": "engine_elastic_crank",
    "32a42375f3efb261": "engine_rig",
    "bc6c582711c86980": "engine_torque",
    "f96f4e8880f2e5d9": "four_bar",
    "873c033291281923": "free_frame",
    "08f305c671ba5091": "pin_ended_cross",
    "f6a838b85a5cf755": "quick_return",
    "4722b751f9c24739": "rotating_cantilever",
    "0a5f4c6a9e6c6bde": "slider_crank_150",
    "507893a846aa4905": "spin_up",
    "8df5efa3bf0fc9be": "two_link_arm",
    "2cb30ef77e876a6c": "v_engine",
}

# Scene -> module that serves it.
SCENES = {
    "double-pendulum": "double_pendulum",
    "engine": "engine",
    "engine-3": "engine_3",
    "engine-elastic-crank": "engine_elastic_crank",
    "engine-paper": "engine_elastic_crank",
    "engine-rig": "engine_rig",
    "engine-torque": "engine_torque",
    "engine-transient": "engine",
    "four-bar": "four_bar",
    "free-frame": "free_frame",
    "pin-ended-cross": "pin_ended_cross",
    "quick-return": "quick_return",
    "rotating-cantilever": "rotating_cantilever",
    "slider-crank-150": "slider_crank_150",
    "spin-up": "spin_up",
    "two-link-arm": "two_link_arm",
    "v-engine": "v_engine",
}
