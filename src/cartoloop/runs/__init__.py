# SPDX-License-Identifier: Apache-2.0
"""Whole runs: from recordings or maps to a folder with all files, with a journal on the way."""
