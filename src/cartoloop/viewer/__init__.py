# SPDX-License-Identifier: Apache-2.0
"""The operator's view of a map in a browser, while it grows and after (sections III and VII)."""
