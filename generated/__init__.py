"""Modules that kaneflex generated from its shipped scenes. Do not edit: ``make derive`` makes them."""

# Structure hash -> module. Scenes of one structure share a module.
STRUCTURES = {
    "5c48be519588b478": "engine",
    "04a39a8c53a4e68f": "engine_3",
    "c78c002d41172b07": "engine_elastic_crank",
    "b4c0ca36bc13b35c": "engine_rig",
}

# Scene -> module that serves it.
SCENES = {
    "engine": "engine",
    "engine-3": "engine_3",
    "engine-elastic-crank": "engine_elastic_crank",
    "engine-paper": "engine_elastic_crank",
    "engine-rig": "engine_rig",
    "engine-transient": "engine",
}
