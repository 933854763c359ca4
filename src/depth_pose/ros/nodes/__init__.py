"""The nodes: thin, managed wrappers of the core's stages."""
