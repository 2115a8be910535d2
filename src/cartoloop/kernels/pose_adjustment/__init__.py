# SPDX-License-Identifier: Apache-2.0
"""The compiled part of :mod:`cartoloop.pose_adjustment`, see the README there."""
