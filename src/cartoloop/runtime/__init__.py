# SPDX-License-Identifier: Apache-2.0
"""The process: its memory, the priorities of its threads, times of stages, the kernel cache."""
