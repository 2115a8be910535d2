# SPDX-License-Identifier: Apache-2.0
"""``python -m bench adjustment``: pose adjustment against other solvers."""
