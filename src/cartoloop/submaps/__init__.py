# SPDX-License-Identifier: Apache-2.0
"""Probability grids and submaps (section IV-B)."""
