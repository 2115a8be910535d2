# SPDX-License-Identifier: Apache-2.0
"""The map database ``map.cartoloop``: all that a finished map consists of, in one SQLite file."""
