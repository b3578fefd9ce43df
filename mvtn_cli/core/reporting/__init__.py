"""What a person gets to look at: the report of a run, plots, contact sheets, tables."""
