# SPDX-License-Identifier: Apache-2.0
"""A robot that is mapped for hours while everything goes wrong, in compressed time."""
