"""Conversions between the core types and messages."""
