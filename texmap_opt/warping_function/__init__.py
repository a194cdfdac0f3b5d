"""Warping functions: what size and direction of cell each place of the part asks for."""
