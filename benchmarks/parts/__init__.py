"""Parts of the benchmark commands."""
