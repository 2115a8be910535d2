# SPDX-License-Identifier: Apache-2.0
"""Worlds, scanners and odometry with known truth."""
