"""How sure a skeleton and each of its joints are, and how each joint was seen."""
