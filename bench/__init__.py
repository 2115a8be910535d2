# SPDX-License-Identifier: Apache-2.0
"""The benchmarks behind every figure that the documentation quotes: ``python -m bench``."""
