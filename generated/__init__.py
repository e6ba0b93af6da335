"""Modules that kaneflex generated from its shipped scenes. Do not edit: ``make derive`` makes them."""

# Structure hash -> module. Scenes of one structure share a module.
STRUCTURES = {
    "585a8feb1a281d7c": "engine",
    "4c32b2069dee06dd": "engine_3",
    "b53c4a0d8dcf3539": "engine_elastic_crank",
    "5b155d8ce71b65c2": "engine_rig",
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
