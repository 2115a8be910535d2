# SPDX-License-Identifier: Apache-2.0
"""Scan to pose in the local frame (section IV)."""
