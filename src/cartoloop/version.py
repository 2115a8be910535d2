# SPDX-License-Identifier: Apache-2.0
"""The version of the program, which all files that it writes name."""

__version__ = "0.1.0"
