"""How large the archive of these tests is."""

FRAMES = 3
CLIPS = 5
