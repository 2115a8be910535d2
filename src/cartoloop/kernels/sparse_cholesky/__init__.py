# SPDX-License-Identifier: Apache-2.0
"""Sparse Cholesky factorization of symmetric systems of 3 x 3 blocks; see the README beside this.

Two entry points: :func:`plan` once for a sparsity pattern, :func:`solve` for every system of it.
"""

from cartoloop.kernels.sparse_cholesky.numeric import Workspace, solve, workspace
from cartoloop.kernels.sparse_cholesky.symbolic import Plan, plan

__all__ = ["Plan", "Workspace", "plan", "solve", "workspace"]
