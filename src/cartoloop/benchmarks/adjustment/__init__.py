# SPDX-License-Identifier: Apache-2.0
"""``cartoloop bench adjustment``: pose adjustment against the solvers of others."""
