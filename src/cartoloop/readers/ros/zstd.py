# SPDX-License-Identifier: Apache-2.0
"""Zstandard: of the standard library where it has it, else the same in rosbags' dependency."""

from __future__ import annotations

import sys

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = ["zstd"]
