# SPDX-License-Identifier: Apache-2.0
"""Maps and files made of a finished or growing result."""
