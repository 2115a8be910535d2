# SPDX-License-Identifier: Apache-2.0
"""The commands of the benchmarks, by what they measure."""
