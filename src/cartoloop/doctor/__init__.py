# SPDX-License-Identifier: Apache-2.0
"""Examination of a recording: its contents, its problems, and how it would be mapped."""

from cartoloop.doctor.examination import Examination, examine
from cartoloop.doctor.findings import Finding

__all__ = ["Examination", "Finding", "examine"]
