"""Skeletons sent to other programs as they are found, without ROS: OSC and WebSocket."""
