# SPDX-License-Identifier: Apache-2.0
"""``python -m bench viewer``: cost and latency of the live view."""
