# SPDX-License-Identifier: Apache-2.0
"""``python -m bench matching``: branch and bound against other exact searches."""
