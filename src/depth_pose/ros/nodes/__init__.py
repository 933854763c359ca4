"""The nodes: thin, managed skins over the core's stages."""
