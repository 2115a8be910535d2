# SPDX-License-Identifier: Apache-2.0
"""Loop closure (section V)."""
