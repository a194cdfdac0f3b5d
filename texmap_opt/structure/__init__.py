"""Structures: joints and struts, from the tiled cell to the net trimmed to a part."""
