"""Archives of recordings: finding them, processing them in parallel, and the report."""
