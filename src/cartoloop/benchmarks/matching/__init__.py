# SPDX-License-Identifier: Apache-2.0
"""``cartoloop bench matching``: branch and bound against other ways to the same answer."""
