# SPDX-License-Identifier: Apache-2.0
"""How often the verdict on a map is right: maps with known truth, half of them wrong."""
