# SPDX-License-Identifier: Apache-2.0
"""Parsing and printing only."""
