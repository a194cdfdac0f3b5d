"""Warps: a grid of hexahedra moved so that its cells follow a warping function."""
