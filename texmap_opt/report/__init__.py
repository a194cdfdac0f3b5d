"""Pictures, plots and the page that report a run."""
