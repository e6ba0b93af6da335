"""Kane's equations of a mechanism of rigid bodies, solved for its motion and its reactions."""
