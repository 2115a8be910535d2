# SPDX-License-Identifier: Apache-2.0
"""ROS 1 and ROS 2 recordings, read without ROS."""
