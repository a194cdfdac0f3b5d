"""Part and lattice joined: booleans, the inner wall of a skin, the result."""
