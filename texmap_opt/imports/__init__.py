"""Structures from the files of other programs: one format a file."""
