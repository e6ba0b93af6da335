"""Modules that kaneflex generated from its shipped scenes. Do not edit: ``make derive`` makes them."""

# Structure hash -> module. Scenes of one structure share a module.
STRUCTURES = {
    "42f33b586bba8283": "engine",
    "cef96ed7bd3ac6d6": "engine_3",
    "0a56ed069bcccfeb": "engine_elastic_crank",
    "da129ecbf97f7ab9": "engine_rig",
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
