# SPDX-License-Identifier: Apache-2.0
"""The benchmarks whose figures the documentation quotes: ``python -m bench``."""
