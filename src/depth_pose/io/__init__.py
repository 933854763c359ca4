"""Reading and writing of recordings and messages, without ROS.

`decode` converts the bytes of images and clouds to metres; `mcap_read` and `mcap_write` read and write
recordings. Millimetres become metres here, once.
"""
