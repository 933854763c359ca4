"""Motion that the program makes itself, from tables and curves with cited sources."""
