"""Skinned bodies, motion sources and what joints can do."""
