"""Radii of struts by optimisation: least compliance at a given volume."""
