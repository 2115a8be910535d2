# SPDX-License-Identifier: Apache-2.0
"""A place that is seen again and again: old submaps and nodes give way to newer ones."""
