"""Unilateral and frictional rows: contacts, impact, dry friction, LuGre, loads that switch."""
