"""Many recordings: which they are, working on them with many processes, and the report."""
