"""Units of length a part's file may be in."""

# Millimetres in one unit; the inch is exact by definition (1959).
MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
# Of files that have feet too; twelve inches.
MM_PER_FOOT = 304.8
