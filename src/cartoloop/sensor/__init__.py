# SPDX-License-Identifier: Apache-2.0
"""What comes in: typed, time-stamped sensor events, poses, range filters, the sensor's profile."""
