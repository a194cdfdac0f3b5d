"""Files: one format a file, and the folder of a run."""
