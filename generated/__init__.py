"""Modules of kaneflex: elements, bodies, joints, tables, scenes. Do not edit: ``make derive`` makes them."""

# Structure hash -> module. Scenes of one structure share a module.
STRUCTURES = {
    "044e7a3d419d8aeb": "bouncing_bar_laws",
    "f8ee2a0a35e7dab3": "bricard_laws",
    "dbe8843e1e9c70d6": "crankshaft_torsion_laws",
    "c2394beeb6ed1e04": "elastic_double_pendulum_laws",
    "3302ebbbfc4bb91f": "engine",
    "fe5482ec0dfc0725": "engine_block_laws",
    "976e5c9aa53b37ba": "engine_rig_clearance_laws",
    "d7ad824fc09dfc5f": "engine_torque_elastic_laws",
    "63642abedd1bcf27": "four_bar",
    "8de652c71222d7c7": "four_bar_misaligned_laws",
    "a5d8b04263499dc7": "four_bar_motor_laws",
    "aca5cf9a75bab0b4": "mathieu",
    "6ada49fa0909a48e": "pulsating_strut",
    "9b37cfd67e928b88": "robot_arm_laws",
    "9a37e7fc449032f7": "rotating_blade_laws",
    "0c250a14fb14cd00": "rotating_cantilever",
    "0a41714101ab0b8c": "slider_crank_150",
    "20a28d78a5c4433d": "slider_crank_clearance_laws",
    "aa12b0ee81ef82eb": "spatial_slider_crank_laws",
    "ac28f6e6bfe70abc": "spatial_slider_crank_elastic_laws",
    "d0171a8273025a46": "spin_up_torque_laws",
    "dd7359b8989c8698": "spinning_top_laws",
    "e94975ed86d5cdfb": "stick_slip_laws",
}
