# SPDX-License-Identifier: Apache-2.0
"""Where a scan fits: correlative, least-squares and branch-and-bound matching."""
