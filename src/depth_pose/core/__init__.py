"""Shared basics: skeleton, camera, frames, rotations, settings, errors."""
