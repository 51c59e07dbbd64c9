"""Loads rcl.so beside rclpy, whose libraries it needs: rcl.py LIBRARY ping|echo"""

import ctypes
import os
import sys

import rclpy  # noqa: F401 - its libraries
import std_msgs.msg  # noqa: F401

sys.stdout.flush()
os._exit(ctypes.CDLL(sys.argv[1]).run(sys.argv[2].encode()))
