# SPDX-License-Identifier: Apache-2.0
"""Sensor events with times, poses, range filters, deskewing, and profiles of sensors."""
