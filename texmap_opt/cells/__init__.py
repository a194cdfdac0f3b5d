"""Unit cells: what is repeated to make a lattice, and the library they come from."""
