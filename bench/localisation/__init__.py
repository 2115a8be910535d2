# SPDX-License-Identifier: Apache-2.0
"""``python -m bench localisation``: where a robot is in maps that it did not make."""
