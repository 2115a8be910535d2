# SPDX-License-Identifier: Apache-2.0
"""What we remember: probability grids, and the submaps made of them (section IV-B)."""
