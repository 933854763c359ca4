"""The browser viewer: depth, people and the state of the nodes, live or of a recording.

It is built on viser (the extra ``view``), runs in a process of its own and draws only the newest frame,
so that it never delays the nodes.
"""
