# SPDX-License-Identifier: Apache-2.0
"""``python -m bench robustness``: recordings and worlds that nothing was tuned to."""
