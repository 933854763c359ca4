"""Starting, watching and ending the nodes' processes."""
