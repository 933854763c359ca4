"""Recordings and messages in and out, with no ROS installed.

`decode` turns the bytes of images and clouds into metres, `mcap_read` and `mcap_write` are
recordings. Millimetres become metres here, once.
"""
