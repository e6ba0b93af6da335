"""Modules of kaneflex: elements, bodies, joints, tables, scenes. Do not edit: ``make derive`` makes them."""

# Structure hash -> module. Scenes of one structure share a module.
STRUCTURES = {
    "71c8417fb3918578": "elastic_double_pendulum_laws",
    "26a616d2f08f2006": "engine",
    "55cf46a75d6b4d49": "four_bar",
    "49e039585b21adbc": "four_bar_motor_laws",
    "16ad16a1cad01661": "mathieu",
    "e636a5a822e03ec6": "pulsating_strut",
    "8d550afc89f34bc2": "rotating_cantilever",
    "7e12956470c4c81f": "slider_crank_150",
    "3f61a00825d62726": "slider_crank_150_coupled_laws",
    "58d43172f1766981": "slider_crank_clearance_laws",
    "d57d0bc182b270c5": "spatial_slider_crank_elastic_laws",
    "ca4ac3b21f0eec15": "spinning_top_laws",
}
