"""From a scene to the text of its module: the build-time half of kaneflex, and the only importer of SymPy."""
