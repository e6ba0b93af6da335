"""Modules of kaneflex: elements, bodies, joints, tables, scenes. Do not edit: ``make derive`` makes them."""

# Structure hash -> module. Scenes of one structure share a module.
STRUCTURES = {
    "c2394beeb6ed1e04": "elastic_double_pendulum_laws",
    "3302ebbbfc4bb91f": "engine",
    "63642abedd1bcf27": "four_bar",
    "a5d8b04263499dc7": "four_bar_motor_laws",
    "aca5cf9a75bab0b4": "mathieu",
    "6ada49fa0909a48e": "pulsating_strut",
    "0c250a14fb14cd00": "rotating_cantilever",
    "0a41714101ab0b8c": "slider_crank_150",
    "8de652c71222d7c7": "slider_crank_150_coupled_laws",
    "20a28d78a5c4433d": "slider_crank_clearance_laws",
    "ac28f6e6bfe70abc": "spatial_slider_crank_elastic_laws",
    "dd7359b8989c8698": "spinning_top_laws",
}
