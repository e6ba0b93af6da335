"""Models of one scene, ranked by cost and error."""
