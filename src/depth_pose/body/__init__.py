"""The skinned human body: its mesh, its skeleton, and how poses move it."""
