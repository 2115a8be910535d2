# SPDX-License-Identifier: Apache-2.0
"""What is in a recording, what is wrong with it, and what the mapper would make of it."""

from cartoloop.doctor.examination import Examination, examine
from cartoloop.doctor.findings import Finding

__all__ = ["Examination", "Finding", "examine"]
