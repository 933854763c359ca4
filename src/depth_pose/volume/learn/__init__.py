"""Training of the volume tracker's models."""
