"""Models of one scene, ranked by what they cost against what they leave wrong."""
