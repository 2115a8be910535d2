# SPDX-License-Identifier: Apache-2.0
"""Damaged and hostile inputs of all kinds: only stated errors, in bounded time and memory."""
