"""Procedural motion, from tables and curves with cited sources."""
